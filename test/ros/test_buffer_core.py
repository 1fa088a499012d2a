"""
BufferCore, which is tf2_py's TransformBuffer: its velocities, times and messages.

data/tf2_velocity.json has recorded answers of lookupVelocityCore and lookupVelocityFullCore.
"""

import json
from types import SimpleNamespace
from typing import Any

from environment import DATA
import numpy as np
import pytest
from rclpy.duration import Duration
from rclpy.time import Time
from ros_node import stamped

import puretf
from puretf import BufferCore

CASES = json.loads((DATA / 'tf2_velocity.json').read_text())


@pytest.mark.parametrize('case', CASES)
def test_velocities_as_in_tf2(case):
    """The velocities are the same up to rounding, with tf2's mistakes; so are the errors."""
    buffer = BufferCore()
    for op in case['ops']:
        buffer.insert(op['stamp_ns'], op['parent'], op['child'], (*op['xyz'], *op['xyzw']),
                      is_static=op['static'])
    for query in case['queries']:
        arguments = [query['tracking'], query['observation']]
        when = Time(nanoseconds=query['time_ns']), Duration(nanoseconds=query['interval_ns'])
        lookup: Any = buffer.lookupVelocityCore
        if 'reference' in query:
            arguments += query['reference'], tuple(query['point']), query['point_frame']
            lookup = buffer.lookupVelocityFullCore
        if 'error' in query:
            with pytest.raises(getattr(puretf, query['error'])) as caught:
                lookup(*arguments, *when)
            assert type(caught.value).__name__ == query['error']
            assert str(caught.value).startswith(query['message'])
            continue
        expected = np.array([query['linear'], query['angular']])
        # tf2 computes with times in float64 seconds; here, the rounding is the same.
        assert (abs(np.array(lookup(*arguments, *when)) - expected)
                < 1e-9 * np.maximum(1.0, abs(expected))).all()


@pytest.mark.parametrize('convert', [
    lambda ns, kind: kind(nanoseconds=ns),
    lambda ns, kind: kind(nanoseconds=ns).to_msg(),
    lambda ns, kind: SimpleNamespace(sec=ns // 10**9, nanosec=ns % 10**9)])
def test_times_and_durations(convert):
    """A time or duration is anything with sec and nanosec, or with nanoseconds."""
    buffer = BufferCore(Duration(seconds=20))
    for second in range(5):  # the stamp may be rclpy's Time, and x an int
        made = stamped('PARENT', 'THISFRAME', x=3 * second)
        made.header.stamp = Time(seconds=second)
        buffer.set_transform(made, 'test')
    time, interval = convert(0, Time), convert(4_001_000_000, Duration)
    velocity = buffer.lookupVelocityCore('THISFRAME', 'PARENT', time, interval)
    assert velocity[0] == pytest.approx((3.0, 0.0, 0.0), abs=1e-2)
    assert velocity == buffer.lookupVelocityFullCore(
        'THISFRAME', 'PARENT', 'PARENT', (0, 0, 0), 'THISFRAME', time, interval)
    assert buffer.can_transform_core('PARENT', 'THISFRAME', convert(10**9, Time)) == (True, '')
    assert buffer.lookup_transform_core(
        target_frame='PARENT', source_frame='THISFRAME', time=convert(2 * 10**9, Time)
    ) == stamped('PARENT', 'THISFRAME', 2 * 10**9, 6.0)


def test_a_stamp_of_numpy():
    """Its integers do not overflow."""
    made = stamped('PARENT', 'THISFRAME')
    made.header.stamp.sec = np.int32(1_700_000_000)
    buffer = BufferCore()
    buffer.set_transform(made, 'test')
    assert buffer.get_latest_common_time('PARENT', 'THISFRAME') == Time(seconds=1_700_000_000)


def test_an_interval_of_length_zero():
    """tf2 returns NaN, which is an error here."""
    buffer = BufferCore()
    buffer.set_transform(stamped('PARENT', 'THISFRAME', 10**9), 'test')
    with pytest.raises(ValueError, match='averaging_interval is too short at this time: 0 ns'):
        buffer.lookupVelocityCore('THISFRAME', 'PARENT', Time(seconds=1), Duration())
