"""What cli/fast_dds.py relies on, of Fast DDS 2.14."""

import time
from types import SimpleNamespace

from conftest import ARM
import pytest
from rclpy.utilities import get_rmw_implementation_identifier

from dummy_arm.cli import fast_dds
from dummy_arm.cli.fast_dds import detach_discovery_listener

pytestmark = pytest.mark.skipif(
    get_rmw_implementation_identifier() != 'rmw_fastrtps_cpp',
    reason='about Fast DDS, and there is another middleware')


def test_nobody_is_heard_of_any_more(ros, start):
    """Not of one that comes, nor that another went; and the node can be destroyed."""
    def publishers():
        return len(ros.node.get_publishers_info_by_topic('/tf'))

    first = start(*ARM)
    ros.until(lambda: publishers() == 1)
    assert not detach_discovery_listener(ros.context.get_domain_id() + 1)
    start(*ARM)
    ros.until(lambda: publishers() == 2)
    assert detach_discovery_listener(ros.context.get_domain_id())
    start(*ARM).line()
    first.close()
    time.sleep(1.0)
    assert publishers() == 2


@pytest.fixture
def debug_log(monkeypatch):
    """List what is logged at debug level."""
    lines: list[str] = []
    monkeypatch.setattr(fast_dds, 'get_logger', lambda name: SimpleNamespace(debug=lines.append))
    return lines


@pytest.mark.parametrize(('name', 'value', 'why'), [
    ('_LIBRARY', 'libfastrtps.so.3', 'libfastrtps.so.3: cannot open shared object file'),
    ('_LOOKUP', '_ZN3gone', 'undefined symbol: _ZN3gone')])
def test_where_it_does_not_apply_it_says_so_at_debug_level(
        ros, monkeypatch, debug_log, name, value, why):
    """With another library or function; and nothing is done."""
    monkeypatch.setattr(fast_dds, name, value)
    assert not detach_discovery_listener(ros.context.get_domain_id())
    (line,) = debug_log
    assert line.startswith('the discovery listener of Fast DDS is not detached: ')
    assert why in line


def test_where_there_is_no_participant_it_says_so_at_debug_level(ros, debug_log):
    """With the domain."""
    domain = ros.context.get_domain_id() + 1
    assert not detach_discovery_listener(domain)
    assert debug_log == ['the discovery listener of Fast DDS is not detached: '
                         f'no participant in the domain {domain}']
