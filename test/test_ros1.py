"""The message format of ROS 1, compared with rosbags."""

import random

from conftest import fail_on_error
import pytest

from dummy_arm.tf import BufferCore
from dummy_arm.tf._core.pose import Batch, Row
from dummy_arm.tf._wire import ros1
from dummy_arm.tf._wire.cdr import MalformedMessage
from dummy_arm.tf._wire.streams import MessageReader

bags = pytest.importorskip('bags')
S = 10**9
NAMES = ['map', 'a', 'ünï/frame', 'n' * 300, 'base_link', '/slash', '']


def some_rows(random, count):
    """Return transforms with any stamp that rosbags accepts, and names of any length."""
    return [Row(random.randrange(2**31 * S), random.choice(NAMES), f'{random.choice(NAMES)}{i}',
                tuple(random.uniform(-9.0, 9.0) for _ in range(7))) for i in range(count)]


@pytest.mark.parametrize('seed', range(20))
def test_it_reads_what_rosbags_writes(seed):
    """The transforms are equal to the last bit."""
    rows = some_rows(random.Random(seed), seed)
    assert ros1.unpack(bags.ros1(rows)) == rows


def test_seconds_have_no_sign():
    """Seconds are unsigned in ROS 1, unlike in ROS 2, so that times last until 2106."""
    data = bags.ros1([bags.row(7 * S, 'map', 'odom')])
    later = data[:8] + (3 * 10**9).to_bytes(4, 'little') + data[12:]
    assert ros1.unpack(later) == [bags.row(3 * 10**9 * S, 'map', 'odom')]
    _, batch = MessageReader(fail_on_error, ros1).read([data, later], '', False)
    assert isinstance(batch, Batch)
    assert [*batch.stamps] == [3 * 10**9 * S]


def test_a_message_that_ends_too_early_is_malformed():
    """A message is refused at whichever byte it is cut off."""
    data = bags.ros1(some_rows(random.Random(1), 3))
    for length in range(len(data)):
        with pytest.raises(MalformedMessage, match=r'truncated|impossible count'):
            ros1.unpack(data[:length])
    with pytest.raises(MalformedMessage, match='impossible count: 8 bytes cannot hold the 5 '):
        ros1.unpack(b'\5\0\0\0abcd')


def test_a_stream_is_read_as_batches():
    """Batches fill a buffer like single transforms, also after the edges have changed."""
    random_ = random.Random(2)
    names = [('map', 'odom'), ('odom', 'base'), ('base', 'ünï')]

    def message(number, edges=names):
        stamp = 10**9 * S + number * S // 100
        return bags.ros1([
            bags.row(stamp, *edge, (number, random_.random(), 0.0, 0.0, 0.0, 0.6, 0.8))
            for edge in edges])

    messages = [message(i) for i in range(50)]
    messages += [message(50, names[:2]), message(51), message(52, [('odom', 'map'), *names[1:]])]
    batches = MessageReader(fail_on_error, ros1).read(messages, '', False)
    assert sum(len(batch.stamps) for batch in batches if isinstance(batch, Batch)) == 50
    at_once, singly = BufferCore(100 * S), BufferCore(100 * S)
    at_once.insert_batches(MessageReader(fail_on_error, ros1).read(
        messages, 'default_authority', False))
    for data in messages:
        for row in ros1.unpack(data):
            singly.insert(*row)
    assert at_once.frames() == singly.frames()
    assert at_once.dump() == singly.dump()
    for child in 'odom', 'base', 'ünï':
        stamp = 10**9 * S + 123_456_789
        parent = {child: parent for parent, child in names}[child]
        assert (at_once.lookup_transform(parent, child, stamp)
                == singly.lookup_transform(parent, child, stamp))
