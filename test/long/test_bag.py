"""Bags: cut off and damaged at many places, each bit flipped, with thousands of topics."""

import pytest

from puretf import bag
from puretf.bag import BagError, read

bags = pytest.importorskip('bags')
S = bags.S


def checked(path, file, data):
    """Read a bag with other data in its file; return how many dynamic transforms are found."""
    file.write_bytes(data)
    counts, error = [0, 0], ''
    for partial in (False, True) if file.suffix == '.mcap' else (False,):
        try:
            frames = read(path, partial=partial).frames()
            counts[partial] = sum(frame.length for frame in frames if not frame.is_static)
        except BagError as caught:
            error = str(caught)
        assert error.isprintable()
    return counts


@pytest.mark.parametrize('kind', bags.ROS2 + bags.ROS1)
def test_cut_off_at_a_thousand_places(tmp_path, kind):
    """It is an error, unless all is there; partial=True reads a part, which grows."""
    path = bags.make(tmp_path, kind, bags.walk(1))
    file = bags.file_of(path)
    whole = file.read_bytes()
    before = 0
    for length in range(0, len(whole), max(1, len(whole) // 1000)):
        whole_read, part_read = checked(path, file, whole[:length])
        assert whole_read in (0, 11)
        assert before <= part_read <= 11
        before = part_read


@pytest.mark.parametrize('kind', bags.ROS2 + bags.ROS1)
def test_damaged_at_300_places(tmp_path, kind):
    """The only error is a BagError with a text of one line."""
    path = bags.make(tmp_path, kind, bags.walk(1))
    file = bags.file_of(path)
    whole = file.read_bytes()
    for at in range(0, len(whole), max(1, len(whole) // 300)):
        for new in b'\0' * 4, b'\xff' * 4, bytes([whole[at] ^ 1]):
            checked(path, file, whole[:at] + new + whole[at + len(new):])


@pytest.mark.parametrize('compression', ['NONE', 'ZSTD'])
def test_each_bit_of_an_mcap_file(tmp_path, show, compression):
    """If a bit is flipped, the file is refused, or everything is read as without the flip."""
    path = bags.checked_mcap(tmp_path / 'x.mcap', compression=compression, seconds=5)
    show(f'{bags.flips(path, range(8 * path.stat().st_size))} flips')


def test_many_topics_with_headers(tmp_path):
    """There may be thousands of topics with headers in a database."""
    path = bags.make(tmp_path, 'db3', [*bags.walk(), *(
        (f'/point_{i}', 300 * S, bags.point(f'frame_{i}'), 'geometry_msgs/msg/PointStamped')
        for i in range(1500))])
    with bag.open(path) as opened:
        assert len([*opened.messages(headers=True)]) == 102
        topics = opened.topics
    assert {frame for topic in topics for frame in topic.headers.frames} == {
        f'frame_{i}' for i in range(1500)}
