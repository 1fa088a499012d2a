"""The parts of rosbags that it does not export, and of mcap, as this package uses them."""

import pytest

bags = pytest.importorskip('bags')
from mcap.records import Channel, Chunk, Message  # noqa: E402
from mcap.stream_reader import breakup_chunk, StreamReader  # noqa: E402
from rosbags.rosbag2.metadata import parse_qos  # noqa: E402
from rosbags.rosbag2.storage_mcap import McapReader  # noqa: E402

QOS = """- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 0, nsec: 0}
  lifespan: {sec: 0, nsec: 0}
  liveliness: 1
  liveliness_lease_duration: {sec: 0, nsec: 0}
  avoid_ros_namespace_conventions: false
"""


class Recording(McapReader):
    """A reader that notes which of its methods are called."""

    def __init__(self, path):
        """Open nothing yet."""
        super().__init__(path)
        self.called = []

    def meta_scan(self):
        """Note the call."""
        self.called.append('meta_scan')
        super().meta_scan()

    def read_index(self):
        """Note the call."""
        self.called.append('read_index')
        super().read_index()


def test_a_file_with_an_index(tmp_path):
    """`read_index` reads the statistics, the chunks, and the connections with their counts."""
    path = bags.file_of(bags.make(tmp_path, 'mcap', bags.walk()))
    reader = Recording(path)
    reader.open()
    assert reader.called == ['read_index']
    assert reader.statistics.message_count == 102
    times = [time for _, time, _ in bags.walk()]
    assert (reader.statistics.start_time, reader.statistics.end_time) == (min(times), max(times))
    counts = {each.topic: each.msgcount for each in reader.connections}
    assert counts == {'/tf': 101, '/tf_static': 1}
    assert sum(sum(chunk.channel_count.values()) for chunk in reader.chunks) == 102
    assert all(chunk.uncompressed_size > 0 < chunk.compressed_size for chunk in reader.chunks)
    assert len([*reader.messages([each for each in reader.connections
                                  if each.topic == '/tf_static'])]) == 1
    reader.close()


def test_a_file_without_an_index(tmp_path):
    """`meta_scan` is called in place of `read_index`; it would read all chunks."""
    path = bags.mcap(tmp_path / 'a.mcap', bags.mcap_channel(),
                     bags.mcap_message([bags.row(bags.S, 'map', 'odom')]))
    reader = Recording(path)
    reader.open()
    assert 'meta_scan' in reader.called
    reader.close()


def test_qos():
    """`parse_qos` reads the profiles that rosbag2 records; they have the enum `durability`."""
    (profile,) = parse_qos(QOS)
    assert profile.durability.name == 'TRANSIENT_LOCAL'


def test_a_chunk_of_mcap(tmp_path):
    """`breakup_chunk` returns the records in a chunk, and checks its CRC."""
    path = bags.file_of(bags.make(tmp_path, 'mcap', bags.walk(1)))
    with path.open('rb') as file:
        chunk = next(record for record in StreamReader(file, emit_chunks=True).records
                     if isinstance(record, Chunk))
    records = breakup_chunk(chunk, validate_crc=True)
    assert {type(record) for record in records} >= {Channel, Message}
    chunk.uncompressed_crc ^= 1
    with pytest.raises(Exception, match='crc'):
        breakup_chunk(chunk, validate_crc=True)
