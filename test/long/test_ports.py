"""The ports that each command opens, and on which address. These tests take 10 s."""

from socket import SOCK_STREAM

import bags
from processes import ARM, tool
import psutil
from ros_node import eventually

#: The commands that use ROS, and what each prints once it runs.
COMMANDS = {
    'dummy_arm': (ARM, 't = 0'),
    'dynamic_tf_publisher': (tool('dynamic_tf_publisher'), 'publishing'),
    'joint_state_publisher': (tool('joint_state_publisher'), 'http'),
    'static_transform_publisher': (tool(
        'static_transform_publisher', '--frame-id', 'a', '--child-frame-id', 'b'), 'Spinning'),
    'tf2_echo': (tool('tf2_echo', 'map', 'end_effector'), 'At time'),
    'tf2_monitor': (tool('tf2_monitor'), 'RESULTS'),
    'view_frames': (tool('view_frames', '--watch'), 'end_effector'),
    'web_view': (tool('web_view'), 'http'),
}


def sockets(pid: int) -> list[tuple[str, str, int]]:
    """Return protocol, address and port of the sockets at which a process receives from others."""
    return [('tcp' if each.type == SOCK_STREAM else 'udp', *each.laddr)
            for each in psutil.net_connections('inet') if each.pid == pid
            and not each.raddr and each.status in (psutil.CONN_LISTEN, psutil.CONN_NONE)]


def is_of_fast_dds(port: int, domain: int) -> bool:
    """
    Return whether Fast DDS may open a UDP port in a ROS domain.

    DDSI-RTPS 2.3, 9.6.1.1: unicast ports are 7400 + 250 * domain + 10 or 11 + 2 * participant.
    Beside them, Fast DDS opens one from 7000 on, and one that the system chooses (Linux: from
    32768 on).
    """
    return 7000 <= port < 7100 or 10 <= port - 7400 - 250 * domain < 250 or port >= 32768


def test_only_pages_open_a_tcp_port_and_on_loopback(start, domain_id):
    """Other commands open UDP ports of Fast DDS; discovery by multicast is off with LOCALHOST."""
    processes = {name: start(*arguments) for name, (arguments, _) in COMMANDS.items()}
    for name, (_, text) in COMMANDS.items():
        processes[name].line_with(text)
    for name, process in processes.items():
        opened = sockets(process.pid)
        tcp = [(address, port) for protocol, address, port in opened if protocol == 'tcp']
        udp = [port for protocol, _, port in opened if protocol == 'udp']
        if name in ('joint_state_publisher', 'web_view'):
            assert [address for address, _ in tcp] == ['127.0.0.1'], opened
        else:
            assert not tcp, (name, opened)
        assert udp, name
        assert all(is_of_fast_dds(port, domain_id) for port in udp), (name, domain_id, opened)
        assert 7400 + 250 * domain_id not in udp, 'the port of discovery by multicast'


def test_a_page_of_a_bag_opens_the_tcp_port_alone(start, tmp_path):
    """The options name its address and port; without ROS, there is no UDP port."""
    path = bags.make(tmp_path, 'mcap file', bags.walk())
    process = start(*tool('web_view', '--bag', str(path), '--host', '127.0.0.2',
                          '--port', '18431'))
    process.line_with('http://127.0.0.2:18431')
    eventually(lambda: sockets(process.pid))
    assert sockets(process.pid) == [('tcp', '127.0.0.2', 18431)]
