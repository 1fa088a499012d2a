"""What is found in the transforms that arrive while a program listens."""

from math import nan
from types import SimpleNamespace
from typing import cast, TYPE_CHECKING

from hypothesis import given, settings
from hypothesis import strategies as st
from messages import recorded, written
import pytest

from puretf._causes.facts import Heard
from puretf._core.pose import Row
from puretf_tools.doctor.checks import diagnose, INFO
from puretf_tools.doctor.observation import Observation
from puretf_tools.doctor.recent import RecentFindings
from puretf_tools.doctor.tf_statistics import Statistics
from puretf_tools.inspection.stamp_clock import StampClock

if TYPE_CHECKING:
    from puretf.publisher_listener import Received, TransformSampler
    from puretf_tools.inspection.frame_listener import FrameListener

S = 10**9
T = 1_700_000_000 * S
TICK = S // 20


def pose(x=0.0, w=1.0):
    return x, 0.0, 0.0, 0.0, 0.0, 0.0, w


class Listener:
    """What a listener knows of the publishers: a.1 and a.2 are of the node /a."""

    topics = '/tf_static', '/tf'

    def __init__(self):
        """Nobody has left, and nothing is late."""
        self.time, self.gone, self.clock, self.ahead = T, set(), StampClock(), {}
        self.late: list[tuple[int, int]] = []
        self.pulse = SimpleNamespace(late=lambda seconds: self.late)
        self.seen: set[str] = set()

    def now(self):
        return self.time

    def clock_text(self):
        """Return '': there is no simulated time."""
        return ''

    def names_of(self, publishers):
        self.seen |= {*publishers}
        return {publisher: f'/{publisher.partition(".")[0]}' for publisher in publishers}

    def is_present(self, publisher):
        return publisher not in self.gone

    @property
    def present(self):
        return self.seen - self.gone


def message(publisher, time, parent, child, *, ahead=0, stamp=None, x=0.0, w=1.0,
            is_static=False, nanosec=None):
    """Return a message with one transform; its stamp is its time, if nothing else is said."""
    stamp = time + ahead if stamp is None else stamp
    return recorded(time, written(
        [Row(stamp, parent, child, pose(x, w))],
        stamps=None if nanosec is None else [(stamp // S, nanosec)]), is_static, publisher)


def robot(time):
    """Return what a healthy robot sends at a time."""
    return [message('base', time, 'odom', 'base_link'), message('arm', time, 'base_link', 'arm')]


class Listened:
    """Findings, and the messages of some publishers, as time passes."""

    def __init__(self):
        """Begin at T, with a static transform."""
        self.listener, self.heard = Listener(), list[tuple[float, Heard]]()
        self.dropped, self.next = 0, 1003.0
        others = SimpleNamespace(poll=int, heard=lambda since: [
            each for time, each in self.heard if time > since])
        self.recent = RecentFindings(cast('FrameListener', self.listener),
                                     cast('TransformSampler', others))
        self.waiting = [message('static', T, 'map', 'odom', is_static=True)]

    @property
    def now(self):
        """The time on the monotonic clock (s)."""
        return (self.listener.time - T) / S + 1000.0

    def after(self, seconds, send=lambda time, i: robot(time)):
        """
        Let 20 times a second be sent what a function returns; return the findings by code.

        They are examined every 3 s, from the 3rd one on.
        """
        for i in range(round(seconds * 20)):
            self.waiting += send(self.listener.time, i)
            self.listener.time += TICK
            if self.now >= self.next and self.update(self.now):
                self.next = self.now + 3.0
        return {each.code: each for each in self.recent.findings}

    def update(self, now):
        received = cast('Received', SimpleNamespace(messages=self.waiting, dropped=self.dropped))
        self.waiting, self.dropped = [], 0
        return self.recent.update(received, now)


@pytest.fixture(autouse=True, scope='module')
def examinations_take_no_time():
    """So they are not put off, however busy this computer is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('puretf_tools.doctor.recent.thread_time', lambda: 0.0)
        yield


@pytest.fixture
def listened():
    """A healthy robot: map, odom, base_link, arm."""
    found = Listened()
    assert not found.after(9)
    return found


def test_a_healthy_robot(listened):
    """Nothing is found, also after minutes, though the static transform was sent once."""
    assert not listened.after(120)
    assert listened.recent.verdict == 'healthy in the last 30 s'


def test_the_first_two_seconds():
    """The static transform, which connects the trees, may be on its way."""
    found = Listened()
    found.waiting = []
    two_trees = beside('hall', 'lamp')
    assert not found.after(3, two_trees)
    assert 'several_trees' in found.after(3, two_trees)


def changed(**fields):
    """Return what is sent if the transforms of arm have other fields."""
    return lambda time, _: [robot(time)[0], message('arm', time, 'base_link', 'arm', **fields)]


def beside(*args, **fields):
    """Return what is sent if another publisher, which stays, sends a transform, too."""
    return lambda time, _: [*robot(time), message('other', time + 1, *args, **fields)]


def once(other):
    """Return what is sent if it is something else in the 30th step."""
    return lambda time, i: other(time, i) if i == 30 else robot(time)


def silent(first, last, *publishers):
    """Return what is sent if some publishers are silent from one step to another one."""
    return lambda time, i: [each for each in robot(time)
                            if not (first <= i < last and each.publisher in publishers)]


def elsewhere(listened):
    """A wheel on another topic."""
    listened.heard = [(1009.0 + i, Heard('/robot/tf', '1', ['/driver'], {'wheel': 'arm'}))
                      for i in range(7)]


def late(listened):
    """The program runs late."""
    listened.listener.late = [(T + 9 * S + i * TICK, S // 20) for i in range(40)]


#: By code: what is sent for 6 s; other findings may follow from it. The clinic has the others.
FAULTS = {
    'two_publishers': beside('odom', 'base_link'),
    'many_publishers': lambda time, i: [
        *robot(time), message(f'other.{i // 10}', time, 'odom', 'tool')],
    'changing_parent': lambda time, i: [
        robot(time)[0], message('arm', time, ('odom', 'base_link')[i % 2], 'arm')],
    'static_and_dynamic': beside('map', 'odom'),
    'not_a_number': changed(x=nan),
    'nanosec': changed(nanosec=2 * S),
    'frozen_stamp': changed(stamp=T + 9 * S),
    'zero_stamp': changed(stamp=0),
    'half_namespace': elsewhere,
    'gap': silent(20, 60, 'arm'),
    'listener_busy': late,
    'jump': once(changed(x=1.0)),
    'one_shot': once(beside('base_link', 'tool')),
    'late': beside('base_link', 'tool', ahead=-S),
    'future': changed(ahead=3 * S // 10),
    'time_goes_back': once(changed(ahead=-2 * S)),
    'empty_name': beside('odom', ''),
    'several_trees': beside('hall', 'lamp'),
    'static_changes': lambda time, i: [*robot(time), *([message(
        'static', time, 'map', 'odom', x=1.0, is_static=True)] if i == 30 else [])],
}


@pytest.mark.parametrize('code', FAULTS)
def test_a_fault_is_found_and_goes(listened, code):
    """It is there when it is sent, over some seconds after that, and gone half a minute later."""
    send = FAULTS[code]
    if code in ('half_namespace', 'listener_busy'):
        send(listened)
        send = silent(2, 22, 'arm') if code == 'listener_busy' else silent(0, 0)
    begin = listened.now
    finding = listened.after(6, send)[code]
    assert (finding.over, begin < finding.since <= listened.now) == (0.0, True)
    end = listened.now
    found = listened.after(12)
    finding, over = found[code], sum(each.over > 0.0 for each in listened.recent.findings)
    assert (f'; over in the last 30 s: {over}' in listened.recent.verdict) == (over > 0)
    assert begin < finding.since
    assert finding.over == 0.0 if code == 'one_shot' else finding.since <= finding.over <= end + 3
    assert listened.after(18) == {}


def test_a_frame_that_is_sent_again(listened):
    """While it is silent, its gap is not over."""
    found = listened.after(9, silent(0, 999, 'arm'))
    assert (found['gap'].frames, found['gap'].over) == (('arm',), 0.0)
    since = found['gap'].since
    assert listened.after(12)['gap'].since == since
    assert listened.after(18) == {}


def test_publishers_that_have_ended(listened):
    """Static transforms count as long as their publisher exists."""
    listened.after(3, once(beside('base_lnk', 'tool', is_static=True)))
    assert listened.after(60)['similar_name'].over == 0.0
    listened.listener.gone.add('other')
    assert listened.after(3) == {}


def test_two_nodes_of_one_name(listened):
    """As when a program is started twice: the name stands once."""
    found = listened.after(6, lambda time, i: [*robot(time), *(
        message(f'x.{number}', time, 'odom', 'tool') for number in '12')])
    assert found['two_publishers'].evidence.startswith('two publishers of /x publish tool: ')


def test_a_busy_computer_is_named(listened):
    """What explains the gap is the only finding."""
    late(listened)
    (finding,) = listened.after(6, silent(2, 22, 'arm')).values()
    assert (finding.code, finding.severity, finding.frames, finding.nodes) == (
        'listener_busy', INFO, ('arm',), ())  # no node is to blame
    assert finding.evidence == ('no transform of arm for 1.05 s after 1700000009.050000000: this '
                                'program was up to 0.05 s late')


def test_all_are_silent_at_once(listened):
    """While they are, and after it, this is one finding."""
    (finding,) = listened.after(6, silent(20, 120, 'arm', 'base')).values()
    assert finding.evidence == 'nothing has arrived from any of 2 nodes in the last 5.05 s'
    (finding,) = listened.after(6).values()
    assert finding.evidence == ('no transform of base_link for 5.05 s after 1700000009.950000000: '
                                'nothing has arrived on any topic for 5.05 s')


def test_messages_that_were_lost(listened):
    """They are no gap: all begins again, with the static transforms."""
    for _ in range(4):
        listened.after(3)
        listened.waiting, listened.dropped = [], 1
        listened.listener.time += 5 * S
        assert not listened.after(3)  # such as several_trees


def test_the_rest_after_an_examination(listened, monkeypatch):
    """It is 19 times as long as the examination, so that it takes 5 % of a core."""
    from puretf_tools.doctor import recent
    spent = iter([0.0, 1.0, 1.0, 1.0])
    monkeypatch.setattr(recent, 'thread_time', lambda: next(spent))
    assert [listened.update(now) for now in (1100.0, 1118.9, 1119.1)] == [True, False, True]


#: Of each node, the frames in its messages; then what each of the nodes sends in 3 s: of which of
#: its frames, and whether with a stamp of 2 s before.
FRAMES = [['base_link', 'wheel'], ['arm', 'hand'], ['base_link', 'lamp']]
PHASES = st.lists(st.lists(st.tuples(st.sets(st.integers(0, 1)), st.booleans()),
                           min_size=3, max_size=3), min_size=1, max_size=16)


@settings(max_examples=30)
@given(PHASES)
def test_any_messages(phases):
    """The codes are those of an observation of the same time, and of the static ones before."""
    found, sent = Listened(), []
    sent += found.waiting
    parents = {'base_link': 'odom', 'wheel': 'base_link', 'arm': 'base_link', 'hand': 'arm',
               'lamp': 'map'}

    def send(time, i):
        number, step = divmod(i, 60)
        new = [recorded(time + node, written([
            Row(time - 2 * S * is_old, parents[name], name, pose())
            for name in (FRAMES[node][index] for index in sorted(indices))]), False, str(node))
            for node, (indices, is_old) in enumerate(phases[number]) if indices and not step % 4]
        sent.extend(new)
        return new

    found.after(3 * len(phases), send)
    last = found.listener.time
    begin = last - 27 * S  # so that what is older than half a minute counts at no time
    statistics = Statistics(S // 5)
    statistics.add_messages([each for each in sent if each.is_static or each.time >= begin])
    fresh = diagnose(Observation(
        statistics, '', nodes={each.publisher: f'/{each.publisher}' for each in sent},
        present={each.publisher for each in sent}, end=last,
        seconds=(last - T) / S - 3.0,
        not_known=dict.fromkeys(('headers', 'listeners', 'qos'), '')))
    assert {each.code for each in found.recent.findings} == {each.code for each in fresh} - {
        'no_transforms'}
