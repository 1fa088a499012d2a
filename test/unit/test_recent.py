"""What is found in the transforms that arrive while a program listens."""

from typing import cast, TYPE_CHECKING

from messages import recorded, written
import pytest

from puretf._causes.facts import Heard
from puretf._core.pose import Row
from puretf_tools.doctor.recent import RecentFindings
from puretf_tools.inspection.stamp_clock import StampClock

if TYPE_CHECKING:
    from puretf_tools.inspection.frame_listener import FrameListener

S = 10**9
T = 1_700_000_000 * S
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class Listener:
    """What a listener knows of the publishers: their nodes have their names, with a slash."""

    topics = '/tf_static', '/tf'

    def __init__(self):
        """Nobody has left."""
        self.time, self.gone, self.clock, self.ahead = T, set(), StampClock(), {}

    def now(self):
        """Return the time (ns)."""
        return self.time

    def clock_text(self):
        """Return '': there is no simulated time."""
        return ''

    def names_of(self, publishers):
        """Return the names of the nodes."""
        return {publisher: f'/{publisher}' for publisher in publishers}

    def is_present(self, publisher):
        """Return whether a publisher exists."""
        return publisher not in self.gone

    @property
    def present(self):
        """The publishers that exist."""
        return {'arm', 'base', 'other', 'static'} - self.gone


class Listened:
    """Findings, and the messages of some publishers, as time passes."""

    def __init__(self):
        """Begin at T, with a static transform."""
        self.listener, self.others = Listener(), []
        self.recent = RecentFindings(cast('FrameListener', self.listener))
        self.publishers = {'base': ('odom', 'base', 20), 'arm': ('base', 'arm', 20)}
        self.waiting = [self.message('static', T, 'map', 'odom', is_static=True)]

    def message(self, publisher, time, parent, child, is_static=False):
        """Return a message with one transform."""
        return recorded(time, written([Row(time, parent, child, STILL)]), is_static, publisher)

    def after(self, seconds, is_complete=True):
        """Let all publish for some seconds; return the codes and frames of what is found."""
        steps = range(round(seconds * 20))
        for step in steps:
            time = self.listener.time + step * S // 20
            self.waiting += [
                self.message(name, time, parent, child)
                for name, (parent, child, hertz) in self.publishers.items()
                if not step % (20 // hertz)]
        self.listener.time += round(seconds * S)
        now = (self.listener.time - T) / S + 1000.0
        if self.recent.is_due(now):
            self.recent.update(self.waiting, is_complete, self.others, now)
            self.waiting = []
        return {(each.code, each.frames) for each in self.recent.findings}


@pytest.fixture
def listened():
    """Publishers of a tree map, odom, base, arm."""
    return Listened()


def test_a_healthy_tree(listened):
    """Nothing is found, also after minutes, though the static transform was sent once."""
    for _ in range(40):
        assert not listened.after(3.1)
    assert listened.recent.verdict == 'healthy in the last 30 s'


def test_a_frame_that_is_sent_seldom(listened):
    """It still connects its tree: what was sent before the statistics began again counts."""
    del listened.publishers['base']
    for ago in 2, 1:
        listened.waiting.append(listened.message('base', T - ago, 'odom', 'base'))
    for _ in range(20):
        assert not {code for code, _ in listened.after(3.1)} & {'several_trees', 'similar_name'}


@pytest.mark.parametrize(('fault', 'expected'), [
    (('base_lnk', 'laser', 20), ('similar_name', ('base_lnk', 'base'))),
    (('odom', 'base', 20), ('two_publishers', ('base',)))])
def test_a_fault_is_found_and_goes(listened, fault, expected):
    """It stays for half a minute after it has gone."""
    listened.publishers['base'] = 'odom', 'base', 20
    if fault[0] == 'base_lnk':
        listened.publishers.update(base=('odom', 'base_link', 20), arm=('base_link', 'arm', 20))
        expected = 'similar_name', ('base_lnk', 'base_link')
    listened.after(3.1)
    listened.publishers['other'] = fault
    assert expected in listened.after(3.1)
    del listened.publishers['other']
    listened.listener.gone.add('other')
    for _ in range(30):
        found = listened.after(3.1)
    assert expected not in found


def test_a_gap_is_found_and_goes(listened):
    """The edge is named; half a minute after the last look at it, it is forgotten."""
    listened.after(6.2)
    arm = listened.publishers.pop('arm')
    listened.after(2.0)
    listened.publishers['arm'] = arm
    assert ('gap', ('arm',)) in listened.after(3.1)
    for _ in range(30):
        found = listened.after(3.1)
    assert not found


def test_half_of_a_robot_in_a_namespace(listened):
    """The frames on the other topic continue the tree."""
    listened.others = [Heard('/robot/tf', '1', ['/driver'], {'wheel': 'base'})]
    assert 'half_namespace' in {code for code, _ in listened.after(3.1)}


def test_messages_that_were_lost(listened):
    """They are no gap: the statistics begin again, with the static transforms."""
    listened.publishers['pole'] = 'map', 'pole', 20
    for _ in range(4):
        listened.after(3.1)
        listened.waiting = []  # lost
        listened.listener.time += 5 * S
        assert not listened.after(3.1, is_complete=False)  # such as several_trees


def test_the_rest_after_an_examination(listened, monkeypatch):
    """It is 19 times as long as the examination, so that it takes 5 % of a core."""
    from puretf_tools.doctor import recent
    spent = iter([0.0, 1.0])
    monkeypatch.setattr(recent, 'thread_time', lambda: next(spent))
    listened.recent.update([], True, [], 1000.0)
    assert not listened.recent.is_due(1018.9)
    assert listened.recent.is_due(1019.1)
