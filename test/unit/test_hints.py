"""The hints of errors: each cause, with made-up clocks and publishers."""

import pickle
import re

from environment import ROOT
import pytest

from dummy_arm.tf import TransformBuffer, TransformException
from dummy_arm.tf._core.engine import engine_of
from dummy_arm.tf._core.hints import Publisher, Surroundings

S = 1_000_000_000
T = 1_700_000_000 * S
STILL = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
TOPICS = '/tf_static', '/tf'
TF = 'tf2_msgs/msg/TFMessage'
ARM = Publisher('/arm', '/tf', TF, True, 'ab')


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


FUTURE = 'See troubleshooting.md: Extrapolation into the future.'
PAST = 'See troubleshooting.md: Extrapolation into the past.'
CLOCKS = ('Set use_sim_time in all nodes, or in none. See troubleshooting.md: use_sim_time and '
          'the wall clock.')
WAIT = 'Pass timeout= to wait for it, or time 0 (Time()) for the latest transform.'


@pytest.mark.parametrize(('ahead', 'surroundings', 'hint'), [
    (S // 2, {}, 'If data still come, this transform is on its way, otherwise the publisher has '
     f'stopped. {WAIT} {FUTURE}'),
    (S // 2, {'now': T + S // 2},
     f'Data still come, so this transform is on its way. {WAIT} {FUTURE}'),
    (S, {'now': T - S}, f'Data still come, so this transform is on its way. {WAIT} {FUTURE}'),
    (5 * S, {'now': T + S}, 'That time is 4.0 s later than the clock of this node, and data still '
     'come. Check the clock that has stamped it, or look up time 0 (Time()) for the latest '
     f'transform. {FUTURE}')])
def test_a_transform_that_comes_later(ahead, surroundings, hint):
    """While data still come, waiting helps; without a clock, this is a condition."""
    assert hint_of(buffer_of(T - S, T, **surroundings), T + ahead) == hint


@pytest.mark.parametrize(('surroundings', 'cause'), [
    ({}, 'the publisher is silent or gone. Check the publisher'),
    ({'topics': TOPICS, 'publishers': [ARM]},
     '/arm, which has published it, still exists, but is silent. Check /arm'),
    ({'topics': TOPICS, 'ended': {'ab': '/arm'}, 'publishers': [ARM._replace(gid='cd')]},
     '/arm, which has published it, has ended. Check /arm'),
    ({'topics': TOPICS, 'publishers': [ARM._replace(topic='/tf_static', gid='cd')]},
     'nothing publishes on /tf any more. Check the publisher'),
    ({'topics': TOPICS, 'publishers': [ARM._replace(gid='2', node='/b\n'), ARM._replace(gid='1')]},
     r'the publisher is silent or gone; the publishers on /tf are /arm, /b\n. Check the '
     'publisher')])
def test_data_that_have_stopped(surroundings, cause):
    """The age of the newest is named, and the node if it is known."""
    buffer = buffer_of(T - S, T, now=T + 5 * S, **surroundings)
    assert hint_of(buffer, T + 4 * S) == (
        f'The newest is 5.0 s old: {cause}, or look up time 0 (Time()) for the latest transform. '
        f'{FUTURE}')


@pytest.mark.parametrize(('time', 'surroundings', 'which'), [
    (T + 61 * S, {}, ', or nothing has been sent since'),
    (T - 62 * S, {}, ''),
    (T + 10**9 * S, {'now': T + 10**9 * S}, ': the requested time is on the system clock of this '
     'node, the data are not, or nothing has been sent since'),
    (5 * S, {'now': 5 * S, 'is_simulated': True},
     ': the requested time is on the simulated clock of this node, the data are not'),
    (5 * S, {'now': T}, ': the data are on the system clock of this node, the requested time is '
     'not'),
    (5 * S, {'now': 2 * T}, ': neither is on the system clock of this node')])
def test_times_of_different_clocks(time, surroundings, which):
    """More than 60 s between the requested time and the data are two clocks."""
    assert hint_of(buffer_of(T - S, T, **surroundings), time) == (
        f'These times are probably from different clocks{which}. {CLOCKS}')


def test_a_publisher_that_ended_long_ago_is_no_other_clock():
    """Its data are old, too, but the ROS graph does not have it any more."""
    buffer = buffer_of(T - S, T, now=T + 300 * S, topics=TOPICS)
    assert hint_of(buffer, T + 300 * S).startswith(
        'The newest is 300.0 s old: nothing publishes on /tf any more. ')


def test_days_are_another_clock_even_without_a_publisher():
    """A bag that was played without --clock has ended."""
    buffer = buffer_of(T - S, T, now=2 * T, topics=TOPICS)
    assert hint_of(buffer, 2 * T).endswith(CLOCKS)


def test_times_that_are_not_kept_any_more():
    """The cache time is named; also if samples were dropped since there were too many."""
    assert hint_of(buffer_of(T - S, T), T - 15 * S) == (
        'The buffer keeps the last 10 s of each frame. Pass a longer cache_time to the buffer, or '
        f'look up sooner. {PAST}')
    buffer = TransformBuffer(max_samples=2)
    for i in range(4):
        buffer.insert(T + i * S, 'map', 'base', STILL)
    assert hint_of(buffer, T) == (
        'Its earlier transforms have been dropped. Pass a longer cache_time, or a larger '
        f'max_samples, to the buffer. {PAST}')


def test_times_before_the_start():
    """Within the cache time, the frame was not published yet, or the listener not there."""
    assert hint_of(buffer_of(T - S, T), T - 5 * S) == (
        'That time is before the first transform that was received. Skip such times, or start '
        f'the listener before its data come. {PAST}')


@pytest.mark.parametrize(('time', 'now', 'is_once'), [
    (T + S, 0, True), (T - S, 0, True), (T + 300 * S, T + 300 * S, True),
    (T + S, T + S // 2, False), (T - S, T + S // 2, False), (2 * T, 2 * T, False)])
def test_a_frame_that_was_sent_once(time, now, is_once):
    """A frame that has just been sent for the first time is none; nor is an old clock."""
    buffer = buffer_of(T, now=now)
    text = str(error_of(buffer, time))
    assert text.endswith(
        'It was sent once as a dynamic transform, or always with the same stamp. Send it again '
        'and again with new stamps or, if it does not move, with a StaticTransformBroadcaster. '
        'See troubleshooting.md: Only one time is in the buffer.') == is_once


def test_a_frame_of_which_one_sample_is_kept():
    """The full buffer has dropped the others."""
    buffer = TransformBuffer(max_samples=1)
    for i in range(3):
        buffer.insert(T + i * S, 'map', 'base', STILL)
    assert hint_of(buffer, T).startswith('Its earlier transforms have been dropped. ')


@pytest.mark.parametrize(('surroundings', 'hint'), [
    ({'publishers': [ARM._replace(type='geometry_msgs/msg/TransformStamped')]},
     '/arm publishes geometry_msgs/msg/TransformStamped on /tf. The type must be '
     'tf2_msgs/msg/TFMessage: send transforms with a TransformBroadcaster or a '
     'StaticTransformBroadcaster. See troubleshooting.md: A frame does not exist.'),
    ({'publishers': [ARM, ARM._replace(topic='/tf_static', node='/lamp')]},
     'Nothing arrives on /tf_static from /lamp, whose publisher is not transient local. Send with '
     'a StaticTransformBroadcaster. See troubleshooting.md: The QoS of /tf_static.'),
    ({'is_volatile': True},
     'This listener of /tf_static is not transient local, so it misses what was sent before its '
     'start. Omit static_qos, or make it transient local. See troubleshooting.md: The QoS of '
     '/tf_static.'),
    ({'other_topics': ['/robot1/tf', '/robot2/tf']},
     'No transform has arrived on /tf, but transforms are published on /robot1/tf, /robot2/tf. '
     "To listen to /robot1/tf, pass tf_topic='/robot1/tf', tf_static_topic='/robot1/tf_static' "
     'to the TransformListener; in commands, pass --namespace robot1. See troubleshooting.md: A '
     'leading slash, or a namespace.')])
def test_frames_that_cannot_arrive(surroundings, hint):
    """A frame does not exist, or two trees are not connected, for a cause in the ROS graph."""
    buffer = buffer_of(T, topics=TOPICS, **surroundings)
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
    assert old.endswith(f'logged once per frame.{end} See troubleshooting.md: TF_OLD_DATA.')
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
    assert len({text.count('troubleshooting') for text in texts}) == 1


def test_nobody_is_asked_while_the_lock_is_held():
    """A query of the ROS graph takes other locks."""
    buffer = buffer_of(T - S, T, now=T)
    with buffer.updated():
        assert 'If data still come' in str(error_of(buffer, T + 1))
    assert 'Data still come' in str(error_of(buffer, T + 1))


def test_a_hint_survives_what_it_asks():
    """The node may be destroyed; the error is none of that."""
    buffer = buffer_of(T - S, T)

    def fail():
        raise RuntimeError

    engine_of(buffer).look = fail
    assert 'If data still come' in str(error_of(buffer, T + 1))


def test_the_sections_that_hints_name_exist():
    """A hint ends with the heading of a section of docs/troubleshooting.md."""
    page = (ROOT / 'docs' / 'troubleshooting.md').read_text()
    source = '\n'.join(path.read_text() for path in (ROOT / 'dummy_arm').rglob('*.py'))
    named = set(re.findall(r'\bsee\(\s*["\']([^"\']+)["\']\)', source))
    assert 'use_sim_time and the wall clock' in named
    assert named <= set(re.findall('^## (.*)$', page, re.MULTILINE))
