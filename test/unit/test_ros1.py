"""The message format of ROS 1, in bags that rosbags writes."""

import random

import pytest

from puretf import bag

bags = pytest.importorskip('bags')
S = 10**9
NAMES = ['map', 'a', 'ünï/frame', 'n' * 300, 'base_link', '/slash', '']


def some_rows(random, count):
    """Return transforms with any stamp that rosbags accepts, and names of any length."""
    return [bags.row(random.randrange(2**31 * S), random.choice(NAMES),
                     f'{random.choice(NAMES)}{i}',
                     tuple(random.uniform(-9.0, 9.0) for _ in range(7))) for i in range(count)]


def rows_in(path, *contents):
    """Write messages, which are rows or bytes, to a bag; yield what is read of each."""
    path = bags.make(path, 'bag', [('/tf', S, content) for content in contents])
    for message in bags.messages(path):
        yield message.rows


def test_it_reads_what_rosbags_writes(tmp_path):
    """The transforms are equal to the last bit."""
    contents = [some_rows(random.Random(seed), seed) for seed in range(20)]
    assert [rows() for rows in rows_in(tmp_path, *contents)] == contents


def test_seconds_have_no_sign(tmp_path):
    """Seconds are unsigned in ROS 1, unlike in ROS 2, so that times last until 2106."""
    data = bags.ros1([bags.row(7 * S, 'map', 'odom')])
    later = data[:8] + (3 * 10**9).to_bytes(4, 'little') + data[12:]
    assert [rows() for rows in rows_in(tmp_path, data, later)] == [
        [bags.row(seconds * S, 'map', 'odom')] for seconds in (7, 3 * 10**9)]
    (frame,) = bag.read(tmp_path / 'walk.bag').frames()
    assert (frame.oldest, frame.latest) == (7 * S, 3 * 10**9 * S)
