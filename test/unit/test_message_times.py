"""From when on messages can be transformed at their stamps: `tf_doctor` against a buffer."""

from dataclasses import replace
from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from recorded import header_of, judged, MS, observed, S, T, tf

from puretf import TransformBuffer
from puretf.bag import Headers
from puretf.transform_buffer import CACHE_TIME
from puretf_tools.doctor.message_times import Verdict

STATIC = tf(0, 0, 'map odom', 'base laser', is_static=True)


def robot(begin, end, delay=5, step=20, edge='odom base'):
    """Return transforms that arrive late by a delay; all in ms."""
    return [tf(i + delay, i, edge) for i in range(begin, end, step)]


#: By verdict and description: the transforms, and the message (arrival, stamp).
ROWS = {
    (Verdict.ZERO_STAMP, 'stamp 0'): (robot(0, 5000), (2000, None)),
    (Verdict.NOT_JUDGED, 'before the first'): (robot(1000, 5000), (1500, 900)),
    (Verdict.NOT_JUDGED, 'before the first so far'): (
        [tf(1000, 1000, 'odom base'), tf(3000, 0, 'odom base'), *robot(3000, 9000)], (2000, 500)),
    (Verdict.NOT_JUDGED, 'before any has arrived'): (robot(1000, 5000), (500, 500)),
    (Verdict.NOT_JUDGED, 'the first arrives later'): (
        [tf(3000, 400, 'odom base'), *robot(3000, 8000)], (500, 500)),
    (Verdict.OTHER_CLOCK, 'future'): (robot(0, 5000), (2000, 70_000)),
    (Verdict.OTHER_CLOCK, 'past'): (robot(0, 5000), (3000, -70_000)),
    (Verdict.NOT_JUDGED, 'latched long before'): (robot(0, 5000), (100, -70_000)),
    (Verdict.AT_ONCE, 'after a restart'): (
        [*robot(0, 30_000), *robot(0, 30_000, delay=40_000)], (50_005, 9990)),
    (Verdict.NOT_JUDGED, 'before a restart'): (
        [*robot(0, 30_000), *robot(0, 30_000, delay=40_000)], (10_005, 9990)),
    (Verdict.TOO_OLD, 'one stamp goes back'): (
        [*robot(0, 20_000), tf(15_000, 0, 'odom base')], (19_990, 9900)),
    (Verdict.NEVER, 'the data end'): ([*robot(0, 1000), tf(9000, 9000, 'map lamp')], (2000, 2000)),
    (Verdict.NOT_JUDGED, 'the last 2 s'): (robot(0, 5000), (4995, 4995)),
    (Verdict.NOT_JUDGED, 'before the first of one edge, dropped by the other'): (
        [*robot(8000, 17_500), *robot(0, 17_500, edge='map odom')], (17_000, 6000)),
    (Verdict.TOO_OLD, 'after the first of one edge, dropped by the other'): (
        [*robot(5000, 14_000), *robot(0, 17_500, edge='map odom')], (17_000, 6000)),
    (Verdict.NEVER, 'too old for the other edge by then'): (
        [tf(i + 5, i, 'odom base') for i in range(0, 20_000, 20)]
        + [tf(100, 100, 'map odom'), tf(19_000, 5000, 'map odom')], (1000, 1000)),
}


@pytest.mark.parametrize(('verdict', 'description'), ROWS)
def test_each_row_of_the_truth_table(verdict, description):
    """The message is judged by these transforms."""
    transforms, message = ROWS[verdict, description]
    times = judged(transforms, [message])
    assert [*times.verdicts] == [verdict]


@pytest.mark.parametrize('frame', ['map', 'odom'])
def test_paths_without_dynamic_edges(frame):
    """A message in the root, or with static transforms to it, can be transformed at once."""
    times = judged([STATIC, *robot(0, 100)], [(50, 90_000), (50, -90_000)], frame)
    assert [*times.verdicts] == [Verdict.AT_ONCE] * 2


def test_frames_of_no_tree_and_loops_are_not_judged():
    """The checks `unknown_frame` and `loop` report them."""
    assert [*judged(robot(0, 100), [(50, 50)], 'lazer').verdicts] == [Verdict.NOT_JUDGED]
    loop = [tf(i, i, 'a b', 'b a') for i in range(0, 100, 20)]
    assert [*judged(loop, [(50, 50)], 'a').verdicts] == [Verdict.NOT_JUDGED]


def test_edges_that_arrive_in_one_message():
    """A topic waits for an edge on the path of its own frame."""
    arms = [tf(i + 5, i, 'base left', 'base right') for i in range(0, 100, 20)]
    headers = {f'/{frame}': observed(arms, [(50, 50)], frame).headers['/scan']
               for frame in ('left', 'right')}
    times = replace(observed(arms, []), headers=headers).message_times
    assert [each.children for each in times] == [['left'], ['right']]


def test_the_clock_of_the_arrivals():
    """A stamp far from all transforms is from another clock only if it is far from now, too."""
    message = 200_000, 199_990  # the transforms ended long ago
    assert [*judged(robot(0, 1000), [message]).verdicts] == [Verdict.NOT_JUDGED]
    assert [*judged(robot(0, 1000), [message], not_known={'arrivals': ''}).verdicts] == [
        Verdict.OTHER_CLOCK]


def test_the_table():
    """The shares, the waits and the queue; numbers that a reader can verify."""
    transforms = [tf(i, i, 'odom base') for i in range(0, 20_000, 400)]  # 2.5 Hz, no delay
    messages = [(i, i) for i in range(400, 10_400, 100)]
    times = judged(transforms, messages)
    # Of four messages, one has the stamp of a transform; the others wait 100, 200 and 300 ms.
    assert times.row() == {
        'topic': '/scan', 'messages': 100, 'judged': 100, 'at_once': 0.25, 'waiting': 0.75,
        'median_wait': 0.2, 'wait_of_95_percent': 0.3, 'largest_wait': 0.3, 'never': 0.0,
        'queue': 3}


def test_the_cache_that_is_needed():
    """It reaches back to the transform before the stamp, as a buffer shows."""
    slow = [tf(i, i, 'odom base') for i in range(0, 40_001, 8000)]
    times = judged(slow, [(i, i - 19_000) for i in range(40_000, 43_000, 100)])
    assert {*times.verdicts.tolist()} == {Verdict.TOO_OLD}
    cache = int(times.waits.max())
    for cache_time, is_enough in (cache, True), (cache - 1, False):
        buffer = TransformBuffer(cache_time=cache_time)
        for each in slow:  # all have arrived before the messages
            buffer.insert(each.time, 'odom', 'base', (0.0,) * 6 + (1.0,))
        assert all(buffer.can_transform('odom', 'base', stamp)
                   for stamp in times.stamps.tolist()) is is_enough


def test_frames_without_times():
    """A frame counts once, however many messages have it."""
    sample = Headers()
    for _ in range(100):
        sample.add_frame(header_of(T, 'laser'))
    sample.add_frame(header_of(T, 'camera'))
    assert [*sample.frames] == ['laser', 'camera']


def test_an_unknown_number_of_messages():
    """If the number of messages is not known, the sample becomes thinner while it grows."""
    sample = Headers(most=20)
    for number in range(1000):
        if sample.wants_next():
            sample.add(number, header_of(number, 'laser'))
    assert sample.arrivals.tolist() == [*range(0, 1000, sample.step)]
    assert sample.step == 64


def test_a_sample_has_the_queue_of_all_messages():
    """Within the step of the sample; and the same shares."""
    transforms = [tf(i, i, 'odom base') for i in range(0, 20_000, 500)]
    messages = [(i, i - 250) for i in range(500, 19_500, 5)]
    whole = judged(transforms, messages)
    sampled = judged(transforms, messages, most=1000)
    assert (whole.step, sampled.step) == (1, 4)
    assert abs(whole.queue() - sampled.queue()) <= 4
    assert sampled.row()['waiting'] == pytest.approx(whole.row()['waiting'], abs=0.02)


def test_transforms_without_times(monkeypatch):
    """Without times of the recording, or with stamps of 0 only, nothing is judged."""
    untimed = [tf(-T // MS, i, 'odom base') for i in range(0, 5000, 20)]
    assert {each.time for each in untimed} == {0}
    assert [*judged(untimed, [(2000, 90_000)]).verdicts] == [Verdict.NOT_JUDGED]
    zero = [tf(i, -T // MS, 'odom base') for i in range(0, 5000, 20)]
    assert [*judged(zero, [(2000, 90_000)]).verdicts] == [Verdict.NOT_JUDGED]


def test_the_queue_counts_messages_that_wait_in_vain():
    """But only those that have arrived after a message that will be passed on."""
    transforms = [tf(i, i, 'odom base') for i in range(0, 1001, 1000)] + [
        tf(9000, 9000, 'map lamp')]
    in_vain = [(600 + i, 5000) for i in range(5)]
    assert judged(transforms, [(500, 500), *in_vain]).queue() == 6
    assert judged(transforms, [*in_vain, (700, 700)]).queue() == 1
    assert judged(transforms, in_vain).queue() == 0


#: What arrives, how long after what came before, and its stamp minus its arrival (0.5 s).
events = st.lists(st.tuples(
    st.sampled_from(['odom base', 'map odom', 'message']), st.integers(0, 5), st.integers(-24, 3)
    | st.integers(-2, 0)), min_size=1, max_size=60)


@settings(max_examples=300)
@given(events)
def test_against_a_buffer(steps):
    """A buffer that receives the same, message by message, can transform at the same times."""
    arrival, transforms, messages = 0, [], []
    newest = {'odom base': -10**9, 'map odom': -10**9}
    for what, pause, shift in steps:
        arrival += 500 * (pause if what == 'message' else max(1, pause))
        if what == 'message':
            messages.append((arrival, arrival + shift * 500))
        else:
            newest[what] = max(newest[what], arrival + shift * 500)
            transforms.append(tf(arrival, newest[what], what))
    if not messages or not transforms:
        return
    times = judged(transforms, messages)
    known = {name for name, stamp in newest.items() if stamp > -10**9}
    if 'odom base' not in known:
        assert {*times.verdicts.tolist()} == {Verdict.NOT_JUDGED}
        return
    root = 'map' if 'map odom' in known else 'odom'
    ready = replayed(transforms, messages, root)
    for verdict, wait, message, (at, is_dropped) in zip(
            times.verdicts.tolist(), times.waits.tolist(), messages, ready):
        if verdict == Verdict.AT_ONCE:
            assert at == message[0], message
        elif verdict == Verdict.WAITS:
            assert at * MS - message[0] * MS == wait, message
        elif verdict != Verdict.NOT_JUDGED:
            assert at is None, (verdict, message)
            if verdict == Verdict.TOO_OLD:
                assert is_dropped


def replayed(transforms, messages, root):
    """Return when each message can first be transformed; None: never; and whether data went."""
    buffer = TransformBuffer(cache_time=CACHE_TIME)
    inserted = sorted(transforms, key=lambda message: message.time)
    results = [[None, False] for _ in messages]
    dropped = False
    for each, following in pairwise([*inserted, None]):
        for row in each.rows():
            buffer.insert(row.stamp_ns, row.frame_id, row.child_frame_id, row.pose)
        now = (each.time - T) // MS
        dropped |= any(
            frame.latest - frame.oldest >= CACHE_TIME - 5 * S for frame in buffer.frames())
        until = (following.time - T) // MS if following else 10**9
        for result, (arrival, stamp) in zip(results, messages):
            if arrival < until and result[0] is None and buffer.can_transform(
                    root, 'base', T + stamp * MS):
                result[0] = max(arrival, now)
            if now <= arrival < until:
                result[1] = dropped
    return results
