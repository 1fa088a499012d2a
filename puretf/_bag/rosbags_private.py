"""
The parts of rosbags 0.11 on which this package relies, but which it does not export.

For each of them, there is a test in test/unit/test_rosbags_private.py.
"""

from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_mcap import McapReader as AnyMcapReader

from puretf._wire.definitions import checked_yaml


class McapReader(AnyMcapReader):
    """A reader that refuses a file without an index, of which it would decompress all chunks."""

    has_statistics = False

    def meta_scan(self) -> None:
        raise ReaderError

    def read_index(self) -> None:
        super().read_index()
        self.has_statistics = self.statistics is not None


def durabilities(profiles: str) -> list[str]:
    """Return the durability in each of the QoS profiles that rosbag2 has recorded as YAML."""
    try:
        return [each.durability.name for each in parse_qos(checked_yaml(profiles.encode()))]
    except Exception:  # a damaged or incomplete text raises errors of many types
        return []
