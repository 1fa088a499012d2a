"""Tests of the behaviour of Fast DDS on which cli/fast_dds.py relies."""

import os
from pathlib import Path

from processes import ARM
import pytest
from rclpy.utilities import get_rmw_implementation_identifier
from ros_node import eventually

from puretf_tools.cli import fast_dds
from puretf_tools.cli.fast_dds import detach_discovery_listener, remove_unfinished_ports

pytestmark = pytest.mark.skipif(
    get_rmw_implementation_identifier() != 'rmw_fastrtps_cpp',
    reason='needs Fast DDS, but another middleware is in use')


def test_a_detached_listener_discovers_nothing(ros, start):
    """Neither the end of a publisher nor a new one is seen, and the node can be destroyed."""
    def publishers():
        return [bytes(info.endpoint_gid)
                for info in ros.node.get_publishers_info_by_topic('/tf')]

    arm = start(*ARM)
    eventually(publishers)
    before = publishers()
    assert not detach_discovery_listener(ros.context.get_domain_id() + 1)
    assert detach_discovery_listener(ros.context.get_domain_id())
    arm.close()
    start(*ARM).line()
    assert publishers() == before


@pytest.mark.parametrize(('name', 'value'), [
    ('_LIBRARIES', ('libfastdds.so.1',)), ('_LOOKUP', '_ZN3gone')])
def test_nothing_is_detached_from_another_fast_dds(ros, monkeypatch, name, value):
    """It has another version, or lacks a function."""
    monkeypatch.setattr(fast_dds, name, value)
    assert not detach_discovery_listener(ros.context.get_domain_id())


OLD = 'fastrtps_port7411'
#: The last one is of a port in use: its first number is 2.
KEPT = {'fastrtps_port7412': b'', f'{OLD}_el': b'', f'{OLD}_mutex': b'', f'sem.{OLD}_mutex': b'',
        'fastrtps_port': b'', 'fastrtps_portal': b'', 'fastrtps_0123456789abcdef': bytes(4096),
        'fastrtps_port7413': b'\2' + bytes(52399)}


@pytest.fixture(params=[b'', bytes(4096), bytes(52400), b'\1' + bytes(52399)],
                ids=['empty', 'page', 'whole', 'begun'])
def shared_memory(tmp_path, request):
    """A directory with a file that was left over, and others, of which one is new."""
    for name, content in {OLD: request.param, **KEPT}.items():
        (tmp_path / name).write_bytes(content)
        if name != 'fastrtps_port7412':
            os.utime(tmp_path / name, (0, 0))
    (tmp_path / 'fastrtps_port7414').symlink_to(OLD)
    return tmp_path


def test_an_unfinished_port_that_was_left_over_is_removed(shared_memory):
    """The line names it. Files that are new, are finished, or have another name are kept."""
    (line,) = remove_unfinished_ports(shared_memory)
    assert line.startswith(f'removed {shared_memory / OLD}: ')
    assert {path.name for path in shared_memory.iterdir()} == {'fastrtps_port7414', *KEPT}
    assert not [*remove_unfinished_ports(shared_memory)]
    assert not [*remove_unfinished_ports(shared_memory / 'missing')]


def test_a_port_in_use_is_finished(ros):
    """Its first number is 2, by which others know that they can use it."""
    ports = [path for path in Path('/dev/shm').glob('fast*_port*')
             if path.name[-1].isdigit() and str(path) in Path('/proc/self/maps').read_text()]
    assert ports
    assert {path.read_bytes()[:4] for path in ports} == {b'\2\0\0\0'}


def test_an_unfinished_port_of_another_user(shared_memory, monkeypatch):
    """The line names the file and the remedy."""
    def unlink(path):
        raise PermissionError(1, 'Operation not permitted')

    monkeypatch.setattr(Path, 'unlink', unlink)
    (line,) = remove_unfinished_ports(shared_memory)
    assert line.startswith(f'cannot remove {shared_memory / OLD} (Operation not permitted): ')
    assert line.endswith(f'remove it as its owner: rm {shared_memory / OLD}')
