"""The hints of errors: each cause, with made-up clocks and publishers."""

import pickle
import re
from time import monotonic_ns
from typing import Any

from environment import ROOT
import pytest

from puretf import TransformBuffer, TransformException
from puretf._core.engine import engine_of
from puretf._core.hints import Blocked, Elsewhere, Publisher, Surroundings

S = 1_000_000_000
T = 1_700_000_000 * S
STILL = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
TOPICS = '/tf_static', '/tf'
TF = 'tf2_msgs/msg/TFMessage'
ARM = Publisher('/arm', '/tf', TF, 'ab')
HEARD: dict[str, Any] = {
    'topics': TOPICS, 'publishers': [ARM], 'is_fed': True, 'has_data': True, 'node': '/me'}


def buffer_of(*stamps, authority='ab', cache_time=10 * S, **surroundings):
    """Return a buffer with the frame base in map at some stamps, and its surroundings."""
    buffer = TransformBuffer(cache_time)
    for stamp in stamps:
        buffer.insert(stamp, 'map', 'base', STILL, authority)
    engine_of(buffer).look = lambda: Surroundings(**surroundings)
    return buffer


def error_of(buffer, time=0, source='base'):
    """Return the error that a lookup raises."""
    with pytest.raises(TransformException) as raised:
        buffer.lookup_transform('map', source, time)
    return raised.value


def hint_of(buffer, time=0, source='base'):
    """Return what follows the edge, or the name of the frame, in the text of an error."""
    text = str(error_of(buffer, time, source))
    _, can_text = buffer.can_transform('map', source, time, return_debug_tuple=True)
    hint = re.split(r'that time\. |does not exist\. |part of the same tree\.', text, maxsplit=1)[1]
    assert can_text.endswith(hint)
    assert text.count('\n') == 0
    return hint


@pytest.fixture
def silent(monkeypatch):
    """Let time pass only by `silent(seconds)`."""
    clock = [monotonic_ns()]
    for module in 'failures', 'insertion':
        monkeypatch.setattr(f'puretf._core.{module}.monotonic_ns', lambda: clock[0])

    def wait(seconds):
        clock[0] += int(seconds * S)

    return wait


#: The short names of the sections.
NAMES = {
    'Extrapolation into the future': 'future', 'Extrapolation into the past': 'past',
    'Only one time is in the buffer': 'one_time', 'A frame does not exist': 'missing_frame',
    'Two unconnected trees': 'two_trees', 'TF_OLD_DATA': 'old_data',
    'use_sim_time and the wall clock': 'clock', 'The QoS of /tf_static': 'tf_static',
    'A jump back in time': 'jump_back', 'A leading slash, or a namespace': 'namespace',
    'A lookup that waits for its own node': 'own_node'}


def see(heading):
    return f'More: tf_doctor --explain {NAMES[heading]}'


FUTURE = see('Extrapolation into the future')
PAST = see('Extrapolation into the past')
ONE_TIME = see('Only one time is in the buffer')
CLOCKS = ('Set use_sim_time in all nodes, or in none; if it is set alike, synchronise the clocks '
          'of the computers.')
ON_ITS_WAY = ('Data still arrive, so this transform is on its way: pass timeout= to wait for '
              f'it, or time 0 (Time()) for the latest transform. {FUTURE}')
LATEST = 'or look up time 0 (Time()) for the latest transform.'


# A buffer without a listener


@pytest.mark.parametrize(('stamps', 'time', 'hint'), [
    ([T - S, T], T + S // 2, 'are from 1699999999.000000000 to 1700000000.000000000 and end '
     f'0.500000000 s before that time. {FUTURE}'),
    ([T - S, T], T + 10**9 * S, 'are from 1699999999.000000000 to 1700000000.000000000 and end '
     f'1000000000.000000000 s before that time. {FUTURE}'),
    ([T], T + S, 'are all at 1700000000.000000000 and end 1.000000000 s before that time. '
     f'{ONE_TIME}'),
    ([T - S, T], T - 3 * S, 'are from 1699999999.000000000 to 1700000000.000000000 and begin '
     f'2.000000000 s after that time. {PAST}'),
    ([-S, S], -2 * S, 'are from -1.000000000 to 1.000000000 and begin 1.000000000 s after that '
     f'time. {PAST}')])
def test_without_a_listener_only_the_data_are_named(stamps, time, hint):
    """Nothing is known of publishers, clocks or of what comes, as in a bag."""
    assert str(error_of(buffer_of(*stamps), time)).endswith(
        f"The data of edge 'map' -> 'base' {hint}")


@pytest.mark.parametrize(('time', 'is_told'), [
    (T // S, True), (T // S - 5, True), (T // S - 6, False), (T // S + 1, False), (T, False)])
def test_a_time_in_seconds_is_told(time, is_told):
    buffer = buffer_of(T - 5 * S, T)
    text = str(error_of(buffer, time)) if time != T else ''
    assert (f'Times are in ns: {time} s is within the data, {time} ns is not.' in text) == is_told


def test_without_a_listener_nothing_is_awaited():
    """Frames that do not exist, two trees, a cleared buffer."""
    buffer = buffer_of()
    assert str(error_of(buffer)).endswith('The buffer is empty.')
    buffer = buffer_of(T)
    assert hint_of(buffer, source='tool') == f"Known frames: 'base', 'map'. {MISSING}"
    buffer.insert(0, 'world', 'lamp', STILL, is_static=True)
    assert hint_of(buffer, source='lamp') == (
        "Tf has two or more unconnected trees. 'map' is in the tree with root 'map', 'lamp' in "
        f"the tree with root 'world'. " f'{see("Two unconnected trees")}')
    buffer.clear()
    assert str(error_of(buffer, T)).endswith(
        "No transform of 'base' has been received since the buffer was cleared, or mended after "
        f'an interrupted insertion. {see("A jump back in time")}')


MISSING = see('A frame does not exist')


# Arrivals


@pytest.mark.usefixtures('silent')
@pytest.mark.parametrize(('ahead', 'surroundings', 'hint'), [
    (S // 2, {}, ON_ITS_WAY),
    (S // 2, {'now': T + S // 2}, ON_ITS_WAY),
    (S, {'now': T - S}, ON_ITS_WAY),
    (5 * S, {'now': T + S}, 'That time is 4.0 s later than the clock of this node, and data still '
     f'arrive. Check the clock that has stamped it, {LATEST} {FUTURE}'),
    (S // 10, {'now': T + 5 * S}, 'Data still arrive, 5.0 s behind the clock of this node (a '
     'recording, or clocks that differ); this transform is on its way: pass timeout= to wait for '
     f'it, or time 0 (Time()) for the latest transform. {FUTURE}'),
    (5 * S, {'now': T + 5 * S}, 'Data still arrive, 5.0 s behind the clock of this node (a '
     'recording, or clocks that differ); this transform is on its way: pass a timeout= of more '
     f'than 5.0 s, or time 0 (Time()) for the latest transform. {FUTURE}'),
    (S // 10, {'now': T + 61 * S}, 'Data still arrive, 61.0 s behind the clock of this node (a '
     'recording, or clocks that differ); this transform is on its way: pass timeout= to wait for '
     f'it, or time 0 (Time()) for the latest transform. {CLOCKS} {FUTURE}')])
def test_data_that_arrive_are_not_silent(ahead, surroundings, hint):
    """However old their stamps are."""
    assert hint_of(buffer_of(T - S, T, **HEARD, **surroundings), T + ahead) == hint


@pytest.mark.parametrize(('stamps', 'silence', 'arrives'), [
    ([T - S, T], 0.9, True), ([T - S, T], 3.5, False), ([T - S, T], 2.9, True),
    ([T - 1, T], 1.5, False), ([T - 10 * S, T], 25, True), ([T - 10 * S, T], 31, False),
    ([T], 0.5, True), ([T], 2, False)])
def test_arrivals_are_judged_by_their_period(silent, stamps, silence, arrives):
    """One that is sent every 10 s is not silent after 25 s."""
    buffer = buffer_of(*stamps, **HEARD)
    silent(silence)
    assert bool(re.match('Data (still )?arrive', hint_of(buffer, T + S // 2))) == arrives


@pytest.mark.parametrize(('surroundings', 'cause'), [
    ({}, '/arm, which has published it, still exists, but is silent. Check /arm'),
    ({'ended': {'ab': '/arm'}, 'publishers': [ARM._replace(gid='cd')]},
     '/arm, which has published it, has ended. Start /arm again'),
    ({'publishers': [ARM._replace(topic='/tf_static', gid='cd')]},
     'nothing publishes on /tf any more. Start the publisher again'),
    ({'publishers': [ARM._replace(gid='2', node='/b\n'), ARM._replace(gid='1')]},
     r'its publisher is silent or gone (on /tf now: /arm, /b\n). Check the publisher')])
def test_data_that_have_stopped(silent, surroundings, cause):
    """The time since the last arrival is named, and the node if it is known."""
    buffer = buffer_of(T - S, T, now=T + 5 * S, **{**HEARD, **surroundings})
    silent(5)
    assert hint_of(buffer, T + 4 * S) == f'None has arrived for 5.0 s: {cause}, {LATEST} {FUTURE}'


def test_a_publisher_that_ended_long_ago_is_no_other_clock(silent):
    buffer = buffer_of(T - S, T, now=T + 300 * S, **{**HEARD, 'publishers': ()})
    silent(300)
    assert hint_of(buffer, T + 300 * S) == (
        'None has arrived for 300.0 s: nothing publishes on /tf any more. Start the publisher '
        f'again, {LATEST} {FUTURE}')


def test_a_bag_that_was_played_without_clock_and_has_ended_is_another_clock(silent):
    buffer = buffer_of(T - S, T, now=2 * T, **{**HEARD, 'publishers': ()})
    silent(300)
    assert hint_of(buffer, 2 * T) == (
        'None has arrived for 300.0 s: nothing publishes on /tf any more. Start the publisher '
        f'again, {LATEST} And the requested time is on the system clock of this node, the data '
        f'are not. {CLOCKS} {FUTURE}')


@pytest.mark.parametrize(('time', 'surroundings', 'which'), [
    (T + 61 * S, {}, 'the requested time and the data are from different clocks, or from a '
     'recording'),
    (T + 10**9 * S, {'now': T + 10**9 * S}, 'the requested time is on the system clock of this '
     'node, the data are not'),
    (2 * T, {'now': T}, 'the data are on the system clock of this node, the requested time is '
     'not')])
def test_arriving_data_of_another_clock(time, surroundings, which):
    """60 s between the requested time and what arrives."""
    assert hint_of(buffer_of(T - S, T, **HEARD, **surroundings), time) == (
        f'Data still arrive, but {which}. {CLOCKS} {see("use_sim_time and the wall clock")}')


@pytest.mark.parametrize(('surroundings', 'which'), [
    ({'now': 5 * S, 'is_simulated': True},
     'The requested time is on the simulated clock of this node, the data are not'),
    ({'now': T},
     'The data are on the system clock of this node, the requested time is not')])
def test_a_time_of_another_clock(surroundings, which):
    """Days before the data."""
    assert hint_of(buffer_of(T - S, T, **HEARD, **surroundings), 5 * S) == (
        f'{which}. {CLOCKS} {see("use_sim_time and the wall clock")}')


def test_a_time_of_another_clock_without_a_listener():
    """No cache would be long enough."""
    buffer = buffer_of(*range(T - 2 * S, T + 10 * S, S), cache_time=S)
    assert hint_of(buffer, 5 * S) == (
        'The requested time and the data are from different clocks, or from a recording. '
        f'{CLOCKS} {see("use_sim_time and the wall clock")}')


@pytest.mark.parametrize('surroundings', [{}, {'now': T, **HEARD}])
def test_an_old_message_may_be_stamped_by_another_clock(surroundings):
    """Both causes are possible at a minute before the data."""
    assert hint_of(buffer_of(T - 90 * S, T - S, T, T, **surroundings), T - 70 * S) == (
        f'If that stamp is not so old, the clocks differ. {CLOCKS} The buffer keeps the last 10 s '
        f'of each frame. Pass a longer cache_time to the buffer, or look up sooner. {PAST}')


@pytest.mark.parametrize(('ahead', 'clocks'), [(30 * S, CLOCKS), (3600 * S, CLOCKS)])
def test_data_ahead_of_the_clock(ahead, clocks):
    """The clock of the publisher is later, so no cache would help."""
    buffer = buffer_of(T + ahead - S, T + ahead, now=T, **HEARD)
    assert hint_of(buffer, T) == (
        f'Data still arrive, {ahead / S:.1f} s ahead of the clock of this node (clocks that '
        f'differ). {clocks} {see("use_sim_time and the wall clock")}')


def test_times_that_are_not_kept_any_more():
    """The cache time is named; also if samples were dropped since there were too many."""
    for surroundings in {}, HEARD:
        assert hint_of(buffer_of(T - 20 * S, T - S, T, T, **surroundings), T - 15 * S) == (
            'The buffer keeps the last 10 s of each frame. Pass a longer cache_time to the '
            f'buffer, or look up sooner. {PAST}')
    buffer = TransformBuffer(max_samples=2)
    for i in range(4):
        buffer.insert(T + i * S, 'map', 'base', STILL)
    assert hint_of(buffer, T) == (
        'Its earlier transforms have been dropped. Pass a longer cache_time, or a larger '
        f'max_samples, to the buffer. {PAST}')


def test_times_before_the_start():
    """Within the cache time, the frame was not published yet, or the listener not there."""
    assert hint_of(buffer_of(T - S, T, **HEARD), T - 5 * S) == (
        'That time is before the first transform that was received. Skip such times, or start '
        f'the listener before its data come. {PAST}')


@pytest.mark.parametrize(('stamps', 'silence', 'how'), [
    ([T], 5, 'Only one has arrived, 5.0 s ago'),
    ([T] * 30, 0, 'All that have arrived have this stamp'),
    ([T] * 30, 5, 'All that have arrived have this stamp'),
    ([T], 0, '')])
def test_a_frame_with_one_stamp(silent, stamps, silence, how):
    """One that has just arrived for the first time is not sent once."""
    buffer = buffer_of(*stamps, **HEARD)
    silent(silence)
    remedy = ('. Send it again and again with new stamps or, if it does not move, with a '
              f'StaticTransformBroadcaster. {ONE_TIME}')
    assert hint_of(buffer, T + S) == (how + remedy if how else ON_ITS_WAY)


@pytest.mark.parametrize('surroundings', [{}, HEARD])
@pytest.mark.parametrize('time', [0, T, T + 6 * S, T + 99 * S])
def test_an_edge_whose_stamp_never_advances(surroundings, time):
    """It is named, not the healthy edge, which has no data for this stamp."""
    buffer = TransformBuffer(cache_time=5 * S)
    for i in range(100):
        buffer.insert(T, 'map', 'odom', STILL)
        buffer.insert(T + i * S // 10, 'odom', 'base', STILL)
    engine_of(buffer).look = lambda: Surroundings(**surroundings)
    with pytest.raises(TransformException) as caught:
        buffer.lookup_transform('map', 'base', time)
    assert re.search(
        r"The data of edge 'map' -> 'odom' are all at 1700000000\.000000000( and end .* s before "
        r'that time)?\. All that have arrived have this stamp\. Send it again and again with new '
        f'stamps or, if it does not move, with a StaticTransformBroadcaster\\. {ONE_TIME}$',
        str(caught.value))


def test_a_frame_of_which_one_sample_is_kept():
    """The full buffer has dropped the others."""
    buffer = TransformBuffer(max_samples=1)
    for i in range(3):
        buffer.insert(T + i * S, 'map', 'base', STILL)
    engine_of(buffer).look = lambda: Surroundings(**HEARD)
    assert hint_of(buffer, T).startswith('Its earlier transforms have been dropped. ')


@pytest.mark.parametrize(('authority', 'surroundings', 'by', 'newer'), [
    ('ab', HEARD | {'ended': {'cd': '/old_run'}}, ' from /arm', ' from /old_run'),
    ('default_authority', HEARD, '', ''), ('default_authority', {}, '', ' from cd'),
    ('sim', {}, ' from sim', ' from cd')])
def test_refused_transforms_are_counted(logs, authority, surroundings, by, newer):
    """After a reset, one late transform of the old run makes all new ones old."""
    buffer = buffer_of(T + 5 * S, T + 100 * S, authority='cd', **surroundings)
    for i in range(50):
        assert not buffer.insert(T + 6 * S + i, 'map', 'base', STILL, authority)
    hint = (f"50 transforms of 'base'{by} were refused, since one at "
            f'1700000100.000000000{newer} is newer by more than the cache time. Clear the buffer; '
            f'if it happens again, stop the node with the later clock. {see("TF_OLD_DATA")}')
    assert hint_of(buffer, T + 6 * S) == hint
    assert '50 transforms' not in hint_of(buffer, T + 9 * S)  # they would not help
    buffer.clear()  # the remedy
    assert buffer.insert(T + 6 * S, 'map', 'base', STILL)
    assert buffer.lookup_transform('map', 'base', T + 6 * S)


def test_a_bag_that_loops_is_refused():
    """Its data still arrive, but none is on its way."""
    buffer = buffer_of(T, T + 20 * S, T + 5 * S, **HEARD)
    assert hint_of(buffer, T + 21 * S).startswith("1 transforms of 'base' from /arm were refused")


def test_a_slow_publisher(silent):
    """It is late, but its clock is not."""
    buffer = buffer_of(T - 10 * S, T, now=T + 8 * S, **HEARD)
    silent(8)
    assert hint_of(buffer, T + 8 * S) == (
        'Data arrive every 10.0 s, so this transform is on its way: pass a timeout= of more than '
        f'8.0 s, or time 0 (Time()) for the latest transform. {FUTURE}')


def test_a_buffer_that_was_cleared_logs_again(logs):
    """Once per frame, from the beginning."""
    buffer = buffer_of(T)
    for count in 1, 2:
        for _ in range(5):
            buffer.insert(T - 11 * S, 'map', 'base', STILL)
        assert len(logs) == count
        buffer.clear()
        buffer.insert(T, 'map', 'base', STILL)


def test_a_buffer_that_is_cleared_again_and_again_logs_once_a_second(logs):
    """As with two publishers of /clock."""
    buffer = buffer_of()
    for _ in range(20):
        buffer.insert(T, 'map', 'base', STILL)
        buffer.insert(T - 11 * S, 'map', 'base', STILL)
        buffer.clear()
    assert len(logs) <= 2


# A lookup that blocks


def waited_error_of(buffer, time, blocked, source='base'):
    """Return the text of the error of a lookup that has waited for 10 ms."""
    engine_of(buffer).find_blocked = lambda: blocked
    with pytest.raises(TransformException) as raised:
        buffer.lookup_transform('map', source, time, timeout=S // 100)
    return str(raised.value)


OWN = see('A lookup that waits for its own node')


@pytest.mark.parametrize(('publisher', 'blocked', 'reason'), [
    (ARM, {'/arm': Blocked('cannot.', ())}, '/arm publishes it, and cannot.'),
    (ARM._replace(node='/me'), {'/me': Blocked('cannot.', ())},
     'This node publishes it, and cannot.'),
    (ARM._replace(gid='1'), {'/me': Blocked('cannot.', {'base'})},
     'This node publishes it, and cannot.'),
    (ARM._replace(gid='1', node='/me'), {'/me': Blocked('cannot.', {'tool'})}, ''),
    (ARM, {'/me': Blocked('cannot.', {'base'})}, '')])
def test_a_lookup_that_keeps_the_publisher_from_publishing(publisher, blocked, reason):
    """It is known by its gid, or since the node has broadcast the frame."""
    buffer = buffer_of(T - S, T, **HEARD | {'publishers': [publisher]})
    text = waited_error_of(buffer, T + S // 2, blocked)
    assert text.endswith(f'that time. {reason} {OWN}' if reason else (
        'Data still arrive, so this transform is on its way: it has not come within 0.01 s, pass '
        f'a longer timeout=, or time 0 (Time()) for the latest transform. {FUTURE}'))
    assert hint_of(buffer, T + S // 2) == ON_ITS_WAY  # without a timeout


def test_a_frame_that_only_a_blocked_node_could_send():
    """But a name that is nearly right is only that."""
    buffer = buffer_of(T, **HEARD | {'publishers': [ARM]})
    blocked = {'/arm': Blocked('cannot.', ())}
    assert waited_error_of(buffer, 0, blocked, 'tool').endswith(
        "Known frames: 'base', 'map'. Only /arm publishes on /tf. If it is to send 'tool', it "
        f'cannot. {OWN}')
    assert waited_error_of(buffer, 0, blocked, 'bsae').endswith(
        f"Nearest known: 'base'. {MISSING}")
    buffer.insert(0, 'world', 'lamp', STILL, is_static=True)
    assert waited_error_of(buffer, 0, blocked, 'lamp').endswith(
        f'Only /arm publishes on /tf. If it is to connect them, it cannot. {OWN}')


# What the ROS graph shows


@pytest.mark.parametrize(('surroundings', 'hint'), [
    ({'publishers': [ARM._replace(type='geometry_msgs/msg/TransformStamped')]},
     '/arm publishes geometry_msgs/msg/TransformStamped on /tf. The type must be '
     'tf2_msgs/msg/TFMessage: send transforms with a TransformBroadcaster or a '
     f'StaticTransformBroadcaster. {MISSING}'),
    ({'publishers': [ARM, ARM._replace(topic='/tf_static', node='/lamp',
                                       lacks='transient local')]},
     'Nothing arrives on /tf_static from /lamp, whose publisher is not transient local. Send with '
     f'a StaticTransformBroadcaster. {see("The QoS of /tf_static")}'),
    ({'publishers': [ARM._replace(lacks='reliable'), ARM._replace(topic='/tf_static')]},
     'Nothing arrives on /tf from /arm, whose publisher is not reliable. Send with a '
     'TransformBroadcaster, or pass a best-effort qos to the TransformListener. '
     f'{see("The QoS of /tf_static")}'),
    ({'is_volatile': True},
     'This listener of /tf_static is not transient local, so it misses what was sent before its '
     f'start. Omit static_qos, or make it transient local. {see("The QoS of /tf_static")}'),
    ({'other_topics': ['/robot1/tf', '/robot2/tf']},
     'No transform has arrived on /tf, but transforms are published on /robot1/tf, /robot2/tf. '
     "To listen to /robot1/tf, pass tf_topic='/robot1/tf', tf_static_topic='/robot1/tf_static' "
     'to the TransformListener; in commands, pass --namespace robot1. '
     f'{see("A leading slash, or a namespace")}')])
def test_frames_that_cannot_arrive(surroundings, hint):
    """A frame does not exist, or two trees are not connected, for a cause in the ROS graph."""
    buffer = buffer_of(T, topics=TOPICS, has_data=True, **surroundings)
    buffer.insert(0, 'world', 'lamp', STILL, is_static=True)
    assert hint_of(buffer, source='bass') == f"Nearest known: 'base'. {hint}"
    assert hint_of(buffer, source='lamp').endswith(f"the tree with root 'world'. {hint}")


@pytest.mark.parametrize(('topic', 'remedy'), [
    ('/tf', "tf_topic='/tf', tf_static_topic='/tf_static' to the TransformListener; in commands, "
     'omit --namespace.'),
    ('/tf_old', "tf_topic='/tf_old', tf_static_topic='/tf_old_static' to the TransformListener; "
     'in commands, pass --ros-args -r /tf:=/tf_old -r /tf_static:=/tf_old_static.')])
def test_other_topics_without_a_namespace(topic, remedy):
    """The remedy is no namespace, or a remapping."""
    buffer = buffer_of(topics=('/a/tf_static', '/a/tf'), other_topics=[topic])
    assert f'No transform has arrived on /a/tf, but transforms are published on {topic}. To ' \
        f'listen to {topic}, pass {remedy}' in hint_of(buffer)


HALF = ('Remap both /tf and /tf_static in all nodes of the robot (--ros-args -r /tf:=/robot1/tf '
        '-r /tf_static:=/robot1/tf_static), or in none of them. More: tf_doctor --explain '
        'half_namespace')
WHOLE = ("To listen to /robot1/tf, pass tf_topic='/robot1/tf', "
         "tf_static_topic='/robot1/tf_static' "
         'to the TransformListener; in commands, pass --namespace robot1. '
         'More: tf_doctor --explain namespace')


@pytest.mark.parametrize(('edge', 'source', 'remedy'), [
    (('base', 'tool'), 'tool', HALF), (('tool', 'map'), 'tool', HALF),
    (('odom', 'tool'), 'tool', WHOLE), (('tool', 'grip'), 'tool', WHOLE),
    (('odom', 'foot'), 'tool', ''), (('base', 'world'), 'lamp', HALF),
    (('world', 'sun'), 'lamp', '')])
def test_half_a_namespace(edge, source, remedy):
    """A missing frame, or the parent of a root, is published on a topic to which none listens."""
    parent, child = edge
    found = Elsewhere(parent, child, '/robot1/tf', ('/robot1/driver',), {child})
    buffer = buffer_of(T, **HEARD, other_topics=['/robot1/tf'], elsewhere=lambda is_wanted: (
        found if is_wanted(found) else None))
    buffer.insert(0, 'world', 'lamp', STILL, is_static=True)
    text = (f'{parent!r} -> {child!r} is published on /robot1/tf by /robot1/driver, but this '
            f'listener is on /tf and /tf_static. {remedy}')
    assert hint_of(buffer, source=source).endswith(text) == bool(remedy)


@pytest.mark.parametrize(('topic', 'siblings', 'source', 'end'), [
    ('/robot2/tf', {'tool'}, 'tool', ''), ('/robot2/tf', {'world'}, 'lamp', ''),
    ('/tf', {'base', 'tool'}, 'tool', 'in commands, omit --namespace.'),
    ('/tf', {'base', 'world'}, 'lamp', '')])
def test_another_robot_is_no_half(topic, siblings, source, end):
    """Namespaces beside each other, or the same children: nothing is to be remapped."""
    (child,) = siblings - {'base'}
    found = Elsewhere('base', child, topic, ('/other',), siblings)
    buffer = buffer_of(T, **HEARD | {'topics': ('/robot1/tf_static', '/robot1/tf')},
                       other_topics=[topic],
                       elsewhere=lambda is_wanted: found if is_wanted(found) else None)
    buffer.insert(0, 'world', 'lamp', STILL, is_static=True)
    text = hint_of(buffer, source=source)
    assert 'Remap' not in text
    assert ('/other' in text) == bool(end)
    assert end in text


def test_a_listener_of_static_transforms_only():
    found = Elsewhere('map', 'tool', '/tf', ('/arm',))
    buffer = buffer_of(topics=['/tf_static'], has_data=True, other_topics=['/tf'],
                       elsewhere=lambda is_wanted: found)
    assert str(error_of(buffer, source='tool')).endswith(
        "'map' -> 'tool' is published on /tf by /arm, but this listener is on /tf_static. Use a "
        f'TransformListener. {MISSING}')


@pytest.mark.parametrize(('surroundings', 'hint'), [
    ({'is_new': True}, 'The listener has just started; discovery can take some seconds.'),
    ({}, '0 publishers on /tf and /tf_static were found in ROS domain 7. '
     'Start a program that publishes, with the same ROS_DOMAIN_ID.'),
    ({'other_domains': lambda: ' Others are in 5.', 'hides_others': 'ROS_LOCALHOST_ONLY=1'},
     '0 publishers on /tf and /tf_static were found in ROS domain 7. Others are '
     'in 5. ROS_LOCALHOST_ONLY=1 hides other machines. Start a program that '
     'publishes, with the same ROS_DOMAIN_ID.'),
    ({'joint_states': '/joint_states'}, '/joint_states has a publisher, but nothing publishes '
     'transforms: start robot_state_publisher FILE.'),
    ({'publishers': [ARM]}, 'Nothing has arrived yet from /arm.')])
def test_nothing_at_all(surroundings, hint):
    buffer = buffer_of(topics=TOPICS, domain=7, **surroundings)
    assert hint_of(buffer) == f'No transform has been received yet. {hint} {MISSING}'


@pytest.mark.parametrize(('nodes', 'text', 'section'), [
    ((), '', 'jump_back'), (('/sim',), ' Publisher of /clock: /sim.', 'jump_back'),
    (('/a', '/b'), ' 2 nodes publish /clock, so that the time jumps between them: /a, /b. Stop '
     'all but one.', 'two_nodes')])
def test_a_cleared_buffer(nodes, text, section):
    buffer = buffer_of(T, **HEARD, is_simulated=True, clock_nodes=nodes)
    buffer.clear()
    assert str(error_of(buffer, T)).endswith(
        f'an interrupted insertion.{text} Pass timeout= to wait for the next one. More: tf_doctor '
        f'--explain {section}')


@pytest.mark.parametrize(('authority', 'publishers', 'end'), [
    ('ab', [ARM], ' Publisher: /arm.'),
    ('cd', [], ' Publisher: /gone.'),
    ('default_authority', [ARM, ARM._replace(node='/b')], ' Publishers on /tf: /arm, /b.'),
    ('default_authority', [], '')])
def test_a_refused_transform_is_logged_with_its_publisher(logs, authority, publishers, end):
    """The publisher follows tf2's words: by its gid or, if there is none, all of the topic."""
    buffer = buffer_of(T, authority=authority, topics=TOPICS, publishers=publishers,
                       ended={'cd': '/gone'})
    buffer.insert(T - 11 * S, 'map', 'base', STILL, authority)
    buffer.insert(T, 'map', 'map', STILL, authority)
    old, own_parent = (record.getMessage() for record in logs)
    assert old.endswith(f'logged once per frame.{end} {see("TF_OLD_DATA")}')
    assert own_parent.endswith(f'because they are the same{end and "."}{end}')


def test_nobody_is_asked_unless_a_text_is_read():
    """Lookups that wait raise many errors, of which only the last one is read, once."""
    buffer = buffer_of(T - S, T)
    calls: list[None] = []

    def look():
        calls.append(None)
        return Surroundings()

    engine_of(buffer).look = look
    error = error_of(buffer, T + S)
    assert calls == []
    texts = {str(error), str(error), repr(error), str(pickle.loads(pickle.dumps(error)))}
    assert len(calls) == 1
    assert len({text.count('More:') for text in texts}) == 1


def test_nobody_is_asked_while_the_lock_is_held():
    """A query of the ROS graph takes other locks."""
    buffer = buffer_of(T - S, T, **HEARD)
    with buffer.updated():
        assert 'Data still arrive' not in str(error_of(buffer, T + 1))
    assert 'Data still arrive' in str(error_of(buffer, T + 1))


def test_a_hint_survives_what_it_asks():
    """The node may be destroyed; the error is none of that."""
    buffer = buffer_of(T - S, T)

    def fail():
        raise RuntimeError

    engine_of(buffer).look = fail
    assert str(error_of(buffer, T + 1)).endswith(f'before that time. {FUTURE}')


def test_the_sections_that_hints_name_exist():
    """A hint ends with the heading of a section of docs/troubleshooting.md."""
    page = (ROOT / 'docs' / 'troubleshooting.md').read_text()
    source = '\n'.join(path.read_text() for path in (ROOT / 'puretf').rglob('*.py'))
    named = set(re.findall(r'\bsee\(\s*["\']([^"\']+)["\']\)', source))
    assert 'use_sim_time and the wall clock' in named
    assert named <= set(re.findall('^## (.*)$', page, re.MULTILINE))
