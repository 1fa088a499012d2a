"""TransformBuffer: the rules of insertion and lookup, errors, Ctrl-C and threads."""

from contextlib import suppress
import gc
import json
import logging
import math
import pickle
import signal
import sys
import threading
from types import SimpleNamespace
from typing import Any, cast
import weakref

from ctrl_c import interruptions
from environment import on_unix
import numpy as np
import pytest
import yaml

from puretf import (
    ConnectivityException,
    LookupException,
    Transform,
    TransformBuffer,
    TransformException,
)

S = 1_000_000_000
T = 1_700_000_000 * S
STILL = (0.0, 0.0, 0.0, 1.0)


def put(buffer, parent, child, stamp=T, x=0.0, **kwargs):
    """Insert the pose of a child x m along the x axis of its parent, without rotation."""
    return buffer.insert(stamp, parent, child, (x, 0.0, 0.0, *STILL), **kwargs)


def x_at(buffer, target, source, time=0):
    """Return the x of the source in the target (m)."""
    return buffer.lookup_transform(target, source, time).translation[0]


def test_the_pose_of_the_source_in_the_target():
    """The pose keeps the values that were inserted, and the stamp that was requested."""
    buffer = TransformBuffer()
    buffer.set_transform(Transform(T, 'map', 'tool', (1.0, 2.0, 3.0), (0.0, 0.0, 1.0, 0.0)))
    answer = buffer.lookup_transform('map', 'tool', T)
    assert answer == Transform(T, 'map', 'tool', (1.0, 2.0, 3.0), (0.0, 0.0, 1.0, 0.0))
    assert answer.apply([1.0, 0.0, 0.0]) == pytest.approx([0.0, 2.0, 3.0])


def test_large_coordinates():
    """Those of UTM are exact to a nanometre: float64 has 52 bits, 5 800 000 m need 23."""
    buffer, east = TransformBuffer(), (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
    buffer.insert(T, 'utm', 'map', (500_000.25, 5_800_000.5, 30.0, *east))
    buffer.insert(T, 'map', 'base', (100.0, 2.0, 0.5, *STILL))
    assert buffer.lookup_transform('utm', 'base').translation == pytest.approx(
        (499_998.25, 5_800_100.5, 30.5), rel=0, abs=2e-9)


def test_a_frame_in_itself_needs_not_be_known():
    """The stamp is the requested time; for time 0, it is the latest stamp of the frame, or 0."""
    buffer = TransformBuffer()
    assert buffer.lookup_transform('x', 'x', T) == Transform(T, 'x', 'x')
    put(buffer, 'a', 'b', T)
    for frame, stamp in ('b', T), ('a', 0):
        assert buffer.lookup_transform(frame, frame).stamp == stamp
        assert buffer.get_latest_common_time(frame, frame) == stamp
    assert buffer.can_transform('', '')
    with pytest.raises(LookupException):
        buffer.lookup_transform_full('x', T, 'x', T, 'x')


def test_clear_forgets_what_moves():
    """After `clear`, the names of all frames and the static transforms are still known."""
    buffer = TransformBuffer()
    put(buffer, 'a', 'b')
    put(buffer, 'b', 'c', is_static=True)
    assert x_at(buffer, 'a', 'b', T) == 0.0
    buffer.clear()
    assert buffer.can_transform('b', 'c', T)
    text = error_text(buffer, 'a', 'b', T)
    assert text.startswith(', when looking up ')
    assert text.endswith(
        ". No transform of 'b' has been received since the buffer was cleared, or mended after "
        'an interrupted insertion. More: tf_doctor --explain jump_back')
    assert error_text(TransformBuffer.load(buffer.dump()), 'a', 'b', T) == text
    with pytest.raises(ConnectivityException):
        buffer.lookup_transform('a', 'b')
    assert buffer.all_frames_as_string() == (
        'Frame b exists with parent NO_PARENT.\nFrame c exists with parent b.\n')
    assert 'b: ' not in buffer.all_frames_as_yaml().splitlines()


@pytest.mark.parametrize(('parent', 'child', 'pose', 'cause'), [
    ('a', 'a', (0, 0, 0, *STILL), 'TF_SELF_TRANSFORM: Ignoring transform from authority "me" with '
     'frame_id and  child_frame_id "a" because they are the same'),
    ('/a', 'a', (0, 0, 0, *STILL), 'TF_SELF_TRANSFORM'),
    ('a', '', (0, 0, 0, *STILL), 'TF_NO_CHILD_FRAME_ID: Ignoring transform from authority "me" '
     'because child_frame_id not set '),
    ('', 'b', (0, 0, 0, *STILL), 'TF_NO_FRAME_ID: Ignoring transform with child_frame_id "b"  '
     'from authority "me" because frame_id not set'),
    ('a', 'b', (math.nan, 0, 0, *STILL), 'TF_NAN_INPUT: Ignoring transform for child_frame_id "b" '
     'from authority "me" because of a nan value in the transform (nan 0.000000 0.000000) '
     '(0.000000 0.000000 0.000000 1.000000)'),
    ('a', 'b', (0, 0, 0, 0, 0, 0, 0), 'TF_NAN_INPUT: Ignoring transform for child_frame_id "b" '
     'from authority "me" because of a nan value in the transform (0.000000 0.000000 0.000000) '
     '(nan nan nan nan): its quaternion is zero'),
    ('a', 'b', (0, 0, 0, 0, 0, math.inf, 1), 'TF_NAN_INPUT'),
])
def test_refuses_with_the_words_of_tf2(parent, child, pose, cause, logs):
    """A refused transform is logged, and its frames stay unknown."""
    buffer = TransformBuffer()
    assert not buffer.insert(T, parent, child, pose, 'me')
    assert logs[0].getMessage().startswith(cause)
    assert not buffer.can_transform('a', 'b')
    assert buffer.all_frames_as_yaml() == '[]'


@pytest.mark.parametrize('pose', [(0, 0, 0, *STILL[1:]), (), [0.0] * 8, np.zeros(6)])
def test_a_pose_of_a_wrong_size(pose):
    """The text says what a pose is."""
    buffer = TransformBuffer()
    with pytest.raises(ValueError, match='^a pose must be 7 numbers, x, y, z and the quaternion '
                       f'x, y, z, w, got {len(pose)}$'):
        buffer.insert(T, 'a', 'b', pose)
    assert buffer.frame_names() == []


def test_warnings_are_logged_once_per_cause_and_frame(logs, monkeypatch):
    """A warning of the same cause about another frame waits until a second is over."""
    now = 100.0
    monkeypatch.setattr('puretf._core.texts.monotonic', lambda: now)
    buffer = TransformBuffer()
    put(buffer, 'a', 'b', T)
    put(buffer, 'a', 'c', T)
    for second in range(2):
        now = 100.0 + second
        for _ in range(3):
            assert not put(buffer, 'a', 'b', T - 11 * S, authority='late')
            assert not put(buffer, 'a', 'a')
            if not second:
                assert not put(buffer, 'a', 'c', T - 12 * S, authority='late')
    messages = [record.getMessage() for record in logs]
    assert [message.split()[0] for message in messages] == [
        'TF_OLD_DATA', 'TF_SELF_TRANSFORM:', 'TF_OLD_DATA']
    assert messages[0].startswith(
        'TF_OLD_DATA ignoring data from the past for frame b at time 1699999989.000000 according '
        'to authority late\nIt is 11.000000 s older than the newest transform of this frame, and '
        '10 s are kept. This is logged once per frame. More')
    assert 'for frame c at time 1699999988.000000' in messages[2]
    assert {record.levelno for record in logs} == {logging.WARNING}


def test_bad_values_change_nothing():
    """A value of a wrong type, or a stamp out of range, leaves the buffer as it was."""
    buffer = TransformBuffer()
    put(buffer, 'a', 'b', T, 1.0)
    for stamp, pose in ((T, ('1', 0, 0, *STILL)), (T, (0, 0, 0, '0', 0, 0, 1)), (T, (0, 0, 0)),
                        (2 ** 63, (0, 0, 0, *STILL)), (0.5, (0, 0, 0, *STILL)),
                        (T + S, (10 ** 400, 0, 0, *STILL))):
        for parent in 'a', 'other':
            with pytest.raises((TypeError, ValueError, OverflowError)):
                buffer.insert(stamp, parent, 'b', pose)  # type: ignore[arg-type]
    for wrong, child in ((None, 'b'), ('a', 5), (b'a', 'b')):
        with pytest.raises(TypeError, match='a frame id must be a str'):
            buffer.insert(T, wrong, child, (0, 0, 0, *STILL))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r'takes a Transform .* got .* of type tuple'):
        buffer.set_transform((T, 'a', 'b'))  # type: ignore[arg-type]
    put(buffer, 'a', 'b', T + 2 * S, 3.0)
    assert x_at(buffer, 'a', 'b', T + S) == 2.0


def error_text(buffer, *arguments):
    """Return the text of the error that a lookup raises."""
    with pytest.raises(TransformException) as error:
        buffer.lookup_transform(*arguments)
    return str(error.value)


def test_an_unknown_frame_is_answered_with_the_nearest():
    """If no name is similar, the error lists some known names, or says that there are none."""
    see = ' More: tf_doctor --explain missing_frame'
    buffer = TransformBuffer()
    assert error_text(buffer, 'map', 'base_link').endswith(
        '"map" passed to lookupTransform argument target_frame does not exist. '
        'No transform has been received yet. More: tf_doctor --explain missing_frame')
    for name in ('base_link', 'base_scan', 'camera', 'imu', 'left_wheel', 'right_wheel'):
        put(buffer, 'map', name)
    assert error_text(buffer, 'map', 'base_lnk') == (
        '"base_lnk" passed to lookupTransform argument source_frame does not exist. '
        f"Nearest known: 'base_link', 'base_scan'.{see}")
    assert error_text(buffer, 'zzz', 'map').endswith(
        f"Known frames: 'base_link', 'map', 'base_scan', 'camera', 'imu' and 2 more.{see}")
    assert buffer.can_transform('map', 'imo', return_debug_tuple=True) == (
        False, 'Invalid frame ID "imo" passed to canTransform argument source_frame - frame does '
        f"not exist. Nearest known: 'imu'.{see}")


TWO_TREES = ("'{}' is in the tree with root 'map', '{}' in the tree with root 'world'. "
             'More: tf_doctor --explain two_trees\n')
#: By description: parent, child and stamps (s), or None: static; a lookup; a part of its error,
#: with a line break where the error begins or ends.
HINTS: dict[str, tuple[list[Any], tuple[Any, ...], str]] = {
    'two trees': (
        [('map', 'odom', [0]), ('odom', 'base', [0]), ('world', 'ball', [0])], ('base', 'ball'),
        'unconnected trees. ' + TWO_TREES.format('base', 'ball')),
    'the roots of an earlier time': (
        [('world', 'left', None), ('map', 'right', None), ('left', 'tool', [0, 1, 2]),
         ('right', 'tool', [3, 4])], ('right', 'tool', 1), TWO_TREES.format('right', 'tool')),
    'two trees at a time without data': (
        [('map', 'base', [0, 1]), ('world', 'ball', [0, 1])], ('base', 'ball', 2),
        'to frame [base]. ' + TWO_TREES.format('base', 'ball')),
    'before the first sample': (
        [('map', 'odom', [0, 1]), ('odom', 'base', [1e-9, 1 + 1e-9])], ('map', 'base', 0),
        '\nLookup would require extrapolation into the past.  Requested time 1700000000.000000 '
        'but the earliest data is at time 1700000000.000000, when looking up transform from frame '
        "[base] to frame [map]. The data of edge 'odom' -> 'base' are from "
        '1700000000.000000001 to 1700000001.000000001 and begin 0.000000001 s after that time. '),
    'after the last sample': (
        [('map', 'odom', [0, 1]), ('odom', 'base', [1e-9, 1 + 1e-9])], ('map', 'base', 3),
        " The data of edge 'map' -> 'odom' are from 1700000000.000000000 to "
        '1700000001.000000000 and end 2.000000000 s before that time. '),
    'after the only sample': (
        [('map', 'late', [0])], ('map', 'late', 1e-9),
        " The data of edge 'map' -> 'late' are all at 1700000000.000000000 and end 0.000000001 s "
        'before that time. '),
    'an edge beside the path ends earlier': (
        [('map', 'odom', [0, 5]), ('odom', 'base', [0, 14.5])], ('odom', 'base', 15),
        '\nLookup would require extrapolation into the future.  Requested time 1700000015.000000 '
        'but the latest data is at time 1700000005.000000, when looking up transform from frame '
        "[base] to frame [odom]. The data of edge 'odom' -> 'base' are from 1700000000.000000000 "
        'to 1700000014.500000000 and end 0.500000000 s before that time. '),
    'the path was another one': (
        [('map', 'b', [2, 6]), ('old', 'tool', [0, 1]), ('b', 'tool', [5, 6]),
         ('map', 'old', [3, 6])], ('map', 'tool', 2),
        " The data of edge 'map' -> 'old' are from 1700000003.000000000 to "
        '1700000006.000000000 and begin 1.000000000 s after that time. '),
}


@pytest.mark.parametrize('description', HINTS)
def test_the_hint_of_an_error(description):
    """It names roots, or the edge of the path and its gap, exact to the nanosecond."""
    edges, (target, source, *seconds), text = HINTS[description]
    buffer = TransformBuffer(100 * S)
    for parent, child, stamps in edges:
        for stamp in stamps or [0]:
            put(buffer, parent, child, T + round(stamp * S), is_static=stamps is None)
    error = error_text(buffer, target, source, *(T + round(at * S) for at in seconds))
    assert text in f'\n{error}\n'


def test_a_loop_is_named():
    """A chain that is too long for tf2 raises the same exception; its text says so."""
    buffer = TransformBuffer()
    put(buffer, 'a', 'b')
    put(buffer, 'b', 'c')
    put(buffer, 'c', 'a')
    put(buffer, 'x', 'y')
    assert error_text(buffer, 'y', 'b').startswith(
        'The tf tree is invalid because it contains a loop.\nFrame b exists with parent a.\n')
    assert ("The loop: 'a' -> 'b' -> 'c' -> 'a'. Remove one of these transforms. More: "
            'tf_doctor --explain other') in [
        line for frame in 'abc' for line in error_text(buffer, 'y', frame).splitlines()]
    chain = TransformBuffer()
    for i in range(1001):
        put(chain, f'f{i}', f'f{i + 1}')
    assert chain.can_transform('f1', 'f1001')
    with pytest.raises(LookupException, match='There is no loop, but a chain of more than 1000'):
        chain.lookup_transform('f0', 'f1001')


@pytest.mark.parametrize('repeats', [1, 9])
def test_many_at_once(repeats):
    """The arrays have one row for each time; the rows without a transform are NaN."""
    buffer = TransformBuffer()
    for second in range(3):
        put(buffer, 'a', 'b', T + second * S, float(second))
    times = np.array([T + S // 2, T - 1, 0, T + 2 * S, T + 2 * S + 1, T] * repeats)
    translations, rotations, known = buffer.lookup_transforms('b', 'a', times)
    n = 6 * repeats
    assert (translations.shape, rotations.shape, known.shape) == ((n, 3), (n, 4), (n,))
    assert (translations.dtype, rotations.dtype, known.dtype) == (
        np.dtype(float), np.dtype(float), np.dtype(bool))
    assert known.tolist() == [True, False, True, True, False, True] * repeats
    assert translations[known, 0].tolist() == [-0.5, -2.0, -2.0, 0.0] * repeats
    assert np.isnan(translations[~known]).all()
    assert np.isnan(rotations[~known]).all()
    assert not buffer.lookup_transforms('a', 'nobody', times)[2].any()
    assert [array.shape for array in buffer.lookup_transforms('a', 'b', [])] == [
        (0, 3), (0, 4), (0,)]


def test_many_at_once_as_matrices():
    """They are those of the transforms; a matrix without a transform is NaN."""
    buffer = TransformBuffer()
    buffer.insert(T, 'a', 'b', (1.0, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5))
    buffer.insert(T + S, 'a', 'b', (2.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8))
    times = [T + S // 4, T - 1, T + S]
    first, unknown, last = buffer.lookup_transforms('a', 'b', times, as_matrices=True)
    assert first == pytest.approx(buffer.lookup_transform('a', 'b', times[0]).matrix())
    assert np.isnan(unknown).all()
    assert last == pytest.approx(np.array([
        [0.28, -0.96, 0.0, 2.0], [0.96, 0.28, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0],
        [0.0, 0.0, 0.0, 1.0]]))
    assert buffer.lookup_transforms('a', 'b', [], as_matrices=True).shape == (0, 4, 4)


@pytest.mark.parametrize('times', [
    np.array([T, T + S]).astype('datetime64[ns]'),
    np.array(['2023-11-14T22:13:20', '2023-11-14T22:13:21'], 'datetime64[s]'),
    [SimpleNamespace(nanoseconds=T), SimpleNamespace(sec=1_700_000_001, nanosec=0)],
    [T, SimpleNamespace(nanoseconds=T + S)]])
def test_many_times_of_other_types(times):
    """Times may be datetime64, or objects with the attributes of ROS."""
    buffer = TransformBuffer()
    buffer.insert_many(times, 'a', 'b', [(1.0, 0.0, 0.0, *STILL), (2.0, 0.0, 0.0, *STILL)])
    assert buffer.path_stamps('a', 'b').tolist() == [T, T + S]
    assert buffer.lookup_transforms('a', 'b', times)[0][:, 0].tolist() == [1.0, 2.0]


@pytest.mark.parametrize(('times', 'error'), [
    ([0.5], r'^times must be integers \(ns\), or times of numpy or ROS, got float64: write '),
    (['now'], r"^times\[0\] must be an integer .*, got 'now' of type str$"),
    ([1, None], r'^times\[1\] must be an integer .*, got None of type NoneType$'),
    ([2**63], r'int64 \(ns\), got 9223372036854775808'),
    ([2**64], r'int64 \(ns\), got 18446744073709551616'),
    ([0, -2**63 - 1], r'int64 \(ns\), got -9223372036854775809'),
    (np.array(['2024', 'NaT'], 'datetime64[D]'), 'got NaT at index 1'),
    (np.array(['1500', '2024'], 'datetime64[D]'),
     'whole ns from 1678 to 2261, got 1500-01-01 to 2024-01-01'),
    (np.array([5], 'datetime64[ps]'), 'whole ns from 1678 to 2261, got 1970-01-01T00:00:00.0'),
    ([[1, 2]], r'shape \(n,\), got \(1, 2\)'),
    (5, r'shape \(n,\), got \(\)')])
def test_many_at_once_refuses_what_are_no_times(times, error):
    """The error says what the argument is instead of an array of times of shape (n,)."""
    with pytest.raises((TypeError, ValueError, OverflowError), match=error):
        TransformBuffer().lookup_transforms('a', 'b', times)


@pytest.mark.parametrize('stamps', [
    [], [5], [1, 2, 3, 4], [4, 1, 3, 2], [2, 2], [1, 2, 2, 2, 3, 3], [12, 1, 2, 11], [0, 1]])
def test_many_insertions_at_once(stamps):
    """The data are as if each pose were inserted, in the order of the stamps."""
    random = np.random.default_rng(1)
    poses = random.normal(size=(len(stamps), 7))
    whole, single = TransformBuffer(10), TransformBuffer(10)
    for buffer in whole, single:
        put(buffer, 'map', 'other', 1)
    assert whole.insert_many(stamps, '/map', '/tool', poses, 'me') is True
    for i in np.argsort(stamps, kind='stable'):
        single.insert(stamps[i], 'map', 'tool', poses[i], 'me')
    assert whole.dump() == single.dump()
    late = [stamp + 3 for stamp in stamps]
    assert whole.insert_many(late, 'odom', 'tool', poses, 'you') is True
    for i in np.argsort(late, kind='stable'):
        single.insert(late[i], 'odom', 'tool', poses[i], 'you')
    assert whole.dump() == single.dump()


def test_many_insertions_in_parts(caplog):
    """The lock is released between parts; one bad pose does not slow down or hide the others."""
    buffer = TransformBuffer(S)
    poses = np.tile((0.0, 0.0, 0.0, *STILL), (5000, 1))
    poses[:, 0], poses[4000, 3:] = np.arange(5000), 0.0
    assert buffer.insert_many(np.arange(1, 5001)[::-1], 'map', 'tool', poses[::-1]) is False
    assert len(buffer.path_stamps('map', 'tool')) == 4999
    assert 'TF_NAN_INPUT: Ignoring transform for child_frame_id "tool"' in caplog.text
    assert buffer.insert_many([5000 - 2 * S, 5001], 'map', 'tool', poses[:2]) is False
    assert len(buffer.path_stamps('map', 'tool')) == 5000
    assert [x_at(buffer, 'map', 'tool', 1 + i) for i in (0, 2499, 2500, 4999)] == [
        0.0, 2499.0, 2500.0, 4999.0]


def test_a_call_with_more_than_the_cache_time(caplog):
    """What is not kept is counted once; the same data again are not blamed on other nodes."""
    stamps = T + S * np.arange(100)
    poses = np.tile((1.0, 0.0, 0.0, *STILL), (100, 1))
    buffer, whole = TransformBuffer(), TransformBuffer(cache_time=None)
    assert buffer.insert_many(stamps, 'map', 'tool', poses) is False
    assert buffer.frames()[0].length == 12  # the cache time is counted back from the 99th
    assert buffer.insert_many(stamps, 'map', 'tool', poses) is False
    assert [record.message.partition(': ')[::2] for record in caplog.records
            if record.message.startswith('TF_EXPIRED')] == [('TF_EXPIRED', (
                'Of 100 transforms for child_frame_id "tool" in one call, 88 are not kept: they '
                'are older than the newest one by more than cache_time, 10 s. Create the buffer '
                'with cache_time=100_000_000_000 (ns), or TransformBuffer(cache_time=None), which '
                'keeps all. This is logged once per frame'))]
    buffer.insert_many(stamps, 'tool', 'tip', poses)
    assert 'TF_EXPIRED: Of 100 transforms for child_frame_id "tip"' in caplog.text  # at once
    assert 'node' not in buffer.why_not('map', 'tool', T)
    assert whole.insert_many(stamps, 'map', 'tool', poses) is True
    assert whole.lookup_transforms('map', 'tool', stamps)[2].all()


@pytest.mark.parametrize(('options', 'kept'), [
    ({'cache_time': None, 'max_samples': 500}, 500), ({'cache_time': S}, 10_000)])
def test_a_call_with_more_than_fits(caplog, options, kept):
    rows = T + np.arange(20_000), 'map', 'tool', np.tile((1.0, 0.0, 0.0, *STILL), (20_000, 1))
    assert TransformBuffer(**options).insert_many(*rows) is False
    assert f'in one call, {20_000 - kept} are not kept: the buffer is full' in caplog.text
    assert TransformBuffer(**options | {'max_samples': None}).insert_many(*rows)


def test_a_buffer_that_was_full_is_not_blamed_later(caplog):
    """What is older than the cache time is, and what is refused as old is no part of that."""
    buffer = TransformBuffer(S)
    for i in range(10_001):
        buffer.insert(T + i, 'map', 'tool', (0.0, 0.0, 0.0, *STILL))
    poses = np.tile((1.0, 0.0, 0.0, *STILL), (100, 1))
    assert not buffer.insert_many(T - 100 * S + np.arange(100), 'map', 'tool', poses)
    assert 'TF_EXPIRED' not in caplog.text
    assert not buffer.insert_many(T + 100 * S + S * np.arange(100), 'map', 'tool', poses)
    assert '97 are not kept: they are older than the newest one by more than cache' in caplog.text


@pytest.mark.parametrize('time', [
    np.datetime64(T, 'ns'), SimpleNamespace(sec=1_700_000_000, nanosec=0)])
def test_one_time(time):
    """Wherever an integer (ns) is a time, a datetime64 and a time of ROS are, too."""
    buffer = TransformBuffer()
    buffer.insert(time, 'map', 'robot', (1.0, 0.0, 0.0, *STILL))
    buffer.set_transform(Transform(time, 'robot', 'tool'))
    assert [frame.latest for frame in buffer.frames(time)] == [T, T]
    assert buffer.lookup_transform('map', 'tool', time).stamp == T
    assert buffer.why_not('map', 'tool', time) == ''
    assert [*buffer.lookup_all(['map'], time)[0]] == ['map', 'robot', 'tool']


@pytest.mark.parametrize(('arguments', 'error'), [
    (([1], 'a', 'b', np.zeros((2, 7))), r'shape \(1, 7\), one for each stamp, got \(2, 7\)'),
    (([1], 'a', 'b', np.zeros((1, 6))), r'got \(1, 6\)'),
    (([1, 2], 'a', 'b', [[1.0] * 7, [1.0] * 6]), r'poses must be numbers, of shape \(2, 7\)'),
    (([1], 'a', 'b', [[None] * 7]), 'poses must be numbers'),
    (([1], 'a', 'b', 'x'), "poses must be numbers, of shape .* got 'x' of type str"),
    (([1.5], 'a', 'b', np.zeros((1, 7))), r'stamps must be integers \(ns\)'),
    (([1], 1, 'b', np.zeros((1, 7))), 'a frame id must be a str'),
    (([1], 'a', 'b', np.zeros((1, 7)), None), 'an authority must be a str')])
def test_many_insertions_with_wrong_arguments(arguments, error):
    """Nothing is inserted."""
    buffer = TransformBuffer()
    with pytest.raises((TypeError, ValueError), match=error):
        buffer.insert_many(*arguments)
    assert not buffer.frame_names()


def test_a_frame_is_removed():
    """Its name stays while it is the parent of another frame; a transform brings it back."""
    buffer = TransformBuffer()
    put(buffer, 'map', 'base', T, 1.0)
    put(buffer, 'base', 'tool', T, 2.0, is_static=True)
    assert x_at(buffer, 'map', 'tool') == 3.0
    buffer.remove('base')
    assert buffer.frame_names() == ['base', 'map', 'tool']
    assert not buffer.can_transform('map', 'tool')
    assert x_at(buffer, 'base', 'tool') == 2.0
    buffer.remove('tool')
    assert buffer.frame_names() == ['base', 'map']
    buffer.remove('base')
    with pytest.raises(LookupException, match='"base" passed to remove does not exist'):
        buffer.remove('base')
    with pytest.raises(LookupException, match="'map'"):
        buffer.lookup_transform('map', 'base')
    put(buffer, 'map', 'base', T - S, 4.0)  # it is not too old
    assert x_at(buffer, 'map', 'base') == 4.0
    with pytest.raises(TypeError, match='a frame must be a str'):
        buffer.remove(cast(str, 5))


def test_numbers_come_out_as_floats():
    """Integers and numbers of numpy are accepted, and returned as Python floats."""
    buffer = TransformBuffer()
    stamp: Any = np.int64(T)
    buffer.insert(stamp, 'a', 'b', (1, 2, 3, *np.array([0.1, 0.2, 0.3, 0.9], np.float32)),
                  is_static=True)
    answer = buffer.lookup_transform('a', 'b')
    assert {type(number) for number in (*answer.translation, *answer.rotation)} == {float}
    assert np.linalg.norm(answer.rotation) == pytest.approx(1.0, abs=1e-15)


def unread_error():
    """Return a buffer, and the error of a lookup in it, whose text is made when it is read."""
    buffer = TransformBuffer()
    put(buffer, 'map', 'tool')
    with pytest.raises(LookupException) as error:
        buffer.lookup_transform('map', 'tol')
    return buffer, error.value.with_traceback(None)


HINT = "does not exist. Nearest known: 'tool'. More: "


def test_an_error_that_nobody_has_read_keeps_names_only():
    """It does not refer to the buffer, so its text is made without a lock while others insert."""
    buffer, error = unread_error()
    gone = weakref.ref(buffer)
    del buffer
    gc.collect()
    assert gone() is None
    assert HINT in str(error)


def test_errors_are_exceptions_like_others():
    """Users can raise and subclass them; str, repr and args contain the hint."""
    buffer, error = unread_error()
    put(buffer, 'map', 'tol')
    assert 'Nearest known: ' in repr(error)
    assert HINT in str(error)
    assert error.args[0] == str(error)
    assert str(LookupException('no path from', 'a')) == "('no path from', 'a')"
    assert repr(TransformException()) == 'TransformException()'
    assert pickle.loads(pickle.dumps(TransformException('a', 5))).args == ('a', 5)


def test_inserts_go_on_after_lookups_at_once_that_were_interrupted(monkeypatch):
    """The kept exception refers to the lookup's arrays, which must not prevent insertions."""
    buffer = TransformBuffer()
    put(buffer, 'a', 'b', T)
    put(buffer, 'a', 'b', T + S)
    monkeypatch.setattr('puretf._core.history.itemgetter', lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError) as kept:
        buffer.lookup_transforms('a', 'b', range(T, T + 99))
    assert put(buffer, 'a', 'b', T + 2 * S)
    assert kept.tb is not None


def test_frames_as_tf2_writes_them():
    """The YAML and the text have the format of tf2."""
    buffer = TransformBuffer()
    assert buffer.all_frames_as_yaml() == '[]'
    assert buffer.all_frames_as_string() == ''
    for i in range(6):
        put(buffer, 'map', 'odom', T + i * S // 4, authority='me')
    put(buffer, 'odom', 'base', 7, is_static=True)
    assert buffer.all_frames_as_yaml() == (
        'odom: \n'
        "  parent: 'map'\n"
        "  broadcaster: 'me'\n"
        '  rate: 4.800\n'
        '  most_recent_transform: 1700000001.250000\n'
        '  oldest_transform: 1700000000.000000\n'
        '  buffer_length: 1.250\n'
        'base: \n'
        "  parent: 'odom'\n"
        "  broadcaster: 'default_authority'\n"
        '  rate: 10000.000\n'
        '  most_recent_transform: 0.000000\n'
        '  oldest_transform: 0.000000\n'
        '  buffer_length: 0.000\n')
    assert buffer.all_frames_as_string() == (
        'Frame odom exists with parent map.\nFrame base exists with parent odom.\n')


def test_the_yaml_of_odd_names_can_be_read():
    """A YAML parser reads the names as they were inserted."""
    odd = ['54', 'on', 'a: b', "it's", '"quoted"', 'two\nlines', 'grün', '\u2028', '-', '1e3', '',
           'null', '#', 'a/b.c-d', '🤖']
    buffer = TransformBuffer()
    for name in odd[1:]:
        put(buffer, odd[0], name)
    put(buffer, "it's", odd[0], authority="o'hara\t")
    read = yaml.safe_load(buffer.all_frames_as_yaml())
    assert set(read) == set(odd) - {''}
    assert (read['54']['parent'], read['54']['broadcaster']) == ("it's", "o'hara\t")


def test_waits_for_data_from_another_thread():
    """A lookup returns when the data arrive, or raises when the timeout is over."""
    buffer = TransformBuffer()
    timer = threading.Timer(0.05, put, [buffer, 'a', 'b'])
    timer.start()
    assert buffer.lookup_transform('a', 'b', T, timeout=60 * S).stamp == T
    timer.join()
    with pytest.raises(LookupException):
        buffer.lookup_transform('a', 'c', T, timeout=S // 100)
    assert not buffer.can_transform_full('a', T, 'b', T + 1, 'a', timeout=S // 100)


def in_a_block(buffer):
    """Use a buffer in a block with its lock."""
    with buffer.updated():
        buffer.frames()


@pytest.mark.parametrize(('use', 'least'), [
    (lambda buffer: buffer.lookup_transform('map', 'nobody', 0, S // 1000), 20),
    (lambda buffer: buffer.lookup_transform_full('map', T, 'nobody', T, 'map', S // 1000), 20),
    (in_a_block, 5)], ids=['lookup', 'full lookup', 'block'])
def test_ctrl_c_leaves_the_buffer_free(use, least):
    """Another thread can insert, wherever it was raised, even while the exception is kept."""
    buffer, places = TransformBuffer(), 0
    put(buffer, 'map', 'tool')
    put(buffer, 'map', 'tool', T + S)

    def work():
        with suppress(LookupException):
            use(buffer)

    for interrupt in interruptions(
            lambda: work, 'engine.py', 'buffer_base.py', 'transform_buffer.py', 'lookup.py',
            'tree.py', 'test_transform_buffer.py', 'contextlib.py'):
        places += 1
        results = []
        thread = threading.Thread(target=lambda: results.append(put(  # noqa: B023
            buffer, 'map', 'tool', T + S + places)), daemon=True)  # noqa: B023
        thread.start()
        thread.join(60.0)
        assert results == [True], f'locked by Ctrl-C at place {places}: {interrupt!r}'
    assert places > least


@pytest.mark.parametrize('is_static', [True, False])
def test_ctrl_c_as_a_frame_gets_a_new_parent_leaves_no_old_path(is_static):
    """A path that was looked up before is not used once the frame has its new parent."""
    buffer, places = None, 0

    def prepare():
        nonlocal buffer
        buffer = TransformBuffer()
        put(buffer, 'map', 'old', x=1.0, is_static=True)
        put(buffer, 'map', 'new', x=2.0, is_static=True)
        put(buffer, 'old', 'tool', T, 10.0, is_static=is_static)
        assert x_at(buffer, 'map', 'tool') == 11.0
        return lambda: put(buffer, 'new', 'tool', T + S, 20.0, is_static=is_static)

    for _ in interruptions(prepare, 'engine.py', 'insertion.py', 'lookup.py', 'tree.py',
                           'history.py'):
        places += 1
        put(buffer, 'new', 'tool', T + S, 20.0, is_static=is_static)
        assert x_at(buffer, 'map', 'tool') == 22.0
    assert places > 10


@on_unix
def test_a_signal_handler_does_not_wait():
    """It may have interrupted the call that would insert the data, so it would wait in vain."""
    buffer, errors = TransformBuffer(), []

    def handle(*_):
        with pytest.raises(LookupException) as error:
            buffer.lookup_transform('map', 'tool', timeout=10**6 * S)
        errors.append(error)

    before = signal.signal(signal.SIGALRM, handle)
    try:
        with buffer.updated():
            signal.raise_signal(signal.SIGALRM)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert errors


def test_nobody_sees_a_half_written_state():
    """Readers run beside a writer that appends, inserts late data and clears."""
    buffer, failures, stop = TransformBuffer(S), list[object](), threading.Event()

    def read():
        while not stop.is_set():
            with suppress(TransformException):
                time = buffer.get_latest_common_time('map', 'b')
                for at in 0, time - S // 60, time - S // 7:
                    answer = buffer.lookup_transform('map', 'b', at)
                    if answer.translation[0] != pytest.approx(2 * (answer.stamp - T) / S):
                        failures.append(answer)
                translations, _, known = buffer.lookup_transforms('map', 'b', [time - 1, 0, time])
                if not np.allclose(translations[known, 1], 2 * translations[known, 0]):
                    failures.append(translations)

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    readers = [threading.Thread(target=read) for _ in range(3)]
    for reader in readers:
        reader.start()
    try:
        for i in range(6000):
            stamp = T + i // 2 * S // 100 - i % 2 * S // 25
            n = (stamp - T) / S
            for parent, child in ('map', 'a'), ('a', 'b'):
                buffer.insert(stamp, parent, child, (n, 2 * n, 0.0, *STILL))
            if i % 1000 == 999:
                buffer.clear()
    finally:
        stop.set()
        sys.setswitchinterval(interval)
        for reader in readers:
            reader.join()
    assert not failures


def test_everything_that_is_known_as_json():
    """`dump` includes frames without samples, and its result is a copy."""
    buffer = TransformBuffer(10 * S)
    put(buffer, 'map', 'tool', T, 1.0, authority='me')
    put(buffer, '/base', '/tool', T + S, 2.0, authority='you')
    for x, authority in (9.0, 'she'), (3.0, 'he'):
        put(buffer, 'map', 'fixed', 5, x, authority=authority, is_static=True)
    known = json.loads(json.dumps(buffer.dump()))
    nothing = {'parents': [], 'stamps': [], 'poses': [], 'authority': '', 'is_static': False,
               'arrived': None}
    assert known == {
        'tool': {'parents': ['map', 'base'], 'stamps': [T, T + S], 'poses': [
            [1, 0, 0, 0, 0, 0, 1], [2, 0, 0, 0, 0, 0, 1]], 'authority': 'you', 'is_static': False,
            'arrived': T + S},
        'map': nothing, 'base': nothing,
        'fixed': {'parents': ['map'], 'stamps': [0], 'poses': [[3, 0, 0, 0, 0, 0, 1]],
                  'authority': 'he', 'is_static': True, 'arrived': 0}}
    assert [*known] == buffer.frame_names()
    assert json.loads(json.dumps(TransformBuffer.load(known).dump())) == known
    for of_frame in buffer.dump().values():
        of_frame['stamps'].append(7)
    assert json.loads(json.dumps(buffer.dump())) == known
    for i in range(2, 13):
        put(buffer, 'base', 'tool', T + i * S)
    assert buffer.dump()['tool']['stamps'][0] == T + S  # expired samples are removed first
    buffer.clear()
    assert buffer.dump()['tool'] == {**nothing, 'arrived': 0}
    assert buffer.dump()['fixed'] == known['fixed']


@pytest.mark.parametrize(('changes', 'error'), [
    ({'stamps': [T, T]}, 'shorter'), ({'poses': [[1.0]]}, 'reshape'), ({'parents': [5]}, 'names'),
    ({'poses': [[0.0] * 7]}, 'normalised'), ({'stamps': [0.5]}, 'float'),
    ({'authority': 5}, 'names'), ({'parents': ['odom']}, 'name'), ({'parents': ['base']}, 'name'),
    ({'parents': [''], 'stamps': [T]}, 'name'), ({'arrived': 'x'}, 'integer'),
    ({'arrived': None}, 'integer')])
def test_a_buffer_is_loaded_from_other_data(changes, error):
    """The error names the frame."""
    buffer = TransformBuffer()
    put(buffer, 'map', 'base')
    dump = buffer.dump()
    dump['base'].update(changes)
    with pytest.raises(ValueError, match=f"frame 'base' are not those that dump.*{error}"):
        TransformBuffer.load(dump)
    with pytest.raises(ValueError, match=r"frame 'base' are not those that dump.*stamps"):
        TransformBuffer.load({'base': {}})
    for name in '', 5:
        with pytest.raises(ValueError, match=f'frame {name!r} are not those'):
            TransformBuffer.load(cast(Any, {name: dump['map']}))
    with pytest.raises(TypeError, match=r'must be what dump.. has returned, got 5 of type int'):
        TransformBuffer.load(cast(Any, 5))


def test_the_chain_between_two_frames():
    """The chain leads from the source to the target along the newest edges."""
    buffer = TransformBuffer()
    for parent, child in ('map', 'odom'), ('odom', 'base'), ('base', 'left'), ('base', 'right'):
        put(buffer, parent, child)
    assert buffer.chain('left', 'right') == ['right', 'base', 'left']
    assert buffer.chain('map', 'left') == ['left', 'base', 'odom', 'map']
    assert buffer.chain('left', 'odom') == ['odom', 'base', 'left']
    assert buffer.chain('map', 'map') == ['map']
    with pytest.raises(LookupException, match='"nobody" passed to lookupTransform'):
        buffer.chain('map', 'nobody')
