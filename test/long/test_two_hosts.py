"""
Two hosts: network namespaces that only a pair of virtual interfaces connects.

The namespaces have no route to any other network. Each has a /dev/shm of its own, as hosts do, so
that Fast DDS cannot use shared memory between them. This needs root and iproute2, and takes 1.5
minutes.
"""

from functools import partial
import os
import re
import shutil
import signal
import subprocess
import sys
import time

from processes import ARM, tool
import pytest
from watching import begin_of, Watch

ADDRESSES = '10.77.0.1', '10.77.0.2'
#: How long the link is down (s).
OUTAGE = 10.0
#: What begins after this time (s) finds nothing any more that was sent before.
LATER = 2.5
#: Gives a program a private /dev/shm in place of that of the machine.
PRIVATE_MEMORY = 'mount -t tmpfs -o size=64m tmpfs /dev/shm && '
#: Starts a program on a host; the arguments are the host, what a shell does first, and python's.
ON_HOST = """
import os, sys
host, first, *arguments = sys.argv[1:]
os.execvp('ip', ['ip', 'netns', 'exec', host, 'sh', '-c', f'{first}exec "$@"', 'sh',
                 sys.executable, '-u', *arguments])
"""
#: Prints once a second by how much the frame that a page shows is older than now (s).
VIEWER = """
import sys, time
host, port, *sys.path[:0] = sys.argv[1:]
from viewer import Viewer
viewer, end = Viewer(int(port), host), time.monotonic() + 40.0
viewer.until(lambda: viewer.detail('parent-time'))
while time.monotonic() < end:
    begin = time.monotonic()
    viewer.until(lambda: time.monotonic() > begin + 1.0)
    print(time.time() - float(viewer.detail('parent-time').split()[0]), flush=True)
"""
#: The errors for which the tests are skipped.
NOT_PERMITTED = re.compile('not permitted|denied|not supported|Unknown device type', re.I)


def ip(*arguments):
    """Run ip, and return what it prints."""
    return subprocess.run(['ip', *arguments], check=True, capture_output=True, text=True).stdout


class Host:
    """A network namespace with an interface `eth`."""

    def __init__(self, number):
        """Create it without the interface."""
        self.number, self.name = number, f'attack-{os.getpid()}-{number}'
        ip('netns', 'add', self.name)

    def ip(self, *arguments):
        """Run ip on this host."""
        return ip('-n', self.name, *arguments)

    def run(self, *arguments):
        """Run a program on this host."""
        return ip('netns', 'exec', self.name, *arguments)

    def connect(self):
        """Give the interface its address, and set it up."""
        self.ip('link', 'set', 'lo', 'up')
        self.ip('link', 'set', 'eth', 'addrgenmode', 'none')  # no IPv6, which sends by itself
        self.ip('address', 'add', f'{ADDRESSES[self.number]}/24', 'dev', 'eth')
        self.ip('link', 'set', 'eth', 'up')

    def sent(self):
        """Return the number of packets and of bytes that the interface has sent."""
        numbers = self.run('cat', '/proc/net/dev').partition('eth:')[2].split()
        return int(numbers[9]), int(numbers[8])


@pytest.fixture
def hosts():
    """Two hosts and the link between them."""
    if shutil.which('ip') is None:
        pytest.skip('there is no ip: apt install iproute2')
    try:
        try:
            first, second = Host(0), Host(1)
            ip('link', 'add', 'name', 'eth', 'netns', first.name, 'type', 'veth',
               'peer', 'name', 'eth', 'netns', second.name)
            first.connect()
            second.connect()
            first.run('sh', '-c', f'{PRIVATE_MEMORY}true')
        except subprocess.CalledProcessError as error:
            if not NOT_PERMITTED.search(error.stderr):
                raise AssertionError(error.stderr) from None
            pytest.skip(f'network namespaces are not permitted here: {error.stderr.strip()}')
        assert 'default' not in first.ip('route') + second.ip('route')
        yield first, second
    finally:
        for number in range(2):
            subprocess.run(['ip', 'netns', 'delete', f'attack-{os.getpid()}-{number}'],
                           check=False, capture_output=True)


@pytest.fixture
def on_host(hosts, start):
    """
    Start a program by `on_host(0, range, …)`, on one of the hosts.

    The range is that of the discovery: SUBNET, or LOCALHOST. The processes end before the hosts.
    """
    def start_on_host(number, discovery_range, *arguments, first=PRIVATE_MEMORY):
        return start('-c', ON_HOST, hosts[number].name, first, *arguments,
                     environment={'ROS_AUTOMATIC_DISCOVERY_RANGE': discovery_range})

    return start_on_host


def test_an_outage_of_the_link(hosts, on_host, show):
    """A late listener gets the arm, and again after ten seconds without the link."""
    begin = begin_of(on_host(0, 'SUBNET', *ARM))
    time.sleep(LATER)
    began = time.time_ns()
    watch = Watch(partial(on_host, 1, 'SUBNET'), [begin])
    show(f'first pose: {watch.fresh(began):.2f} s after the start of the listener')
    hosts[0].ip('link', 'set', 'eth', 'down')
    time.sleep(LATER)
    before = watch.process.output
    time.sleep(OUTAGE - LATER)
    assert watch.process.output == before, 'the link was not down'
    hosts[0].ip('link', 'set', 'eth', 'up')
    seconds = watch.fresh(time.time_ns())
    show(f'first fresh pose: {seconds:.2f} s after the link was up again')


def test_with_localhost_nothing_leaves_the_host(hosts, on_host, show):
    """An arm with LOCALHOST sends nothing to the other host; one with SUBNET is received there."""
    begins: list[int] = []
    watch = Watch(partial(on_host, 1, 'SUBNET'), begins)
    before = hosts[0].sent()
    arm = on_host(0, 'LOCALHOST', *ARM)
    begin_of(arm)
    time.sleep(2 * LATER)
    assert not arm.has_ended()
    arm.end(signal.SIGINT)
    between = hosts[0].sent()
    assert watch.process.output == 'ready\n'
    begins.append(begin_of(on_host(0, 'SUBNET', *ARM)))
    watch.fresh(begins[0])
    for discovery_range, first, last in (
            ('LOCALHOST', before, between), ('SUBNET', between, hosts[0].sent())):
        show(f'{discovery_range}: {last[0] - first[0]} packets, {last[1] - first[1]} bytes')
    assert between == before


def test_a_page_over_a_slow_link_is_not_late(hosts, on_host):
    """A queue of the updates that a link of 160 kbit/s cannot carry would grow."""
    for host in hosts:
        host.run('tc', 'qdisc', 'add', 'dev', 'eth', 'root', 'tbf', 'rate', '160kbit',
                 'burst', '4kb', 'latency', '5s')
    on_host(0, 'LOCALHOST', *ARM, first='')
    view = on_host(0, 'LOCALHOST', *tool('web_view', '--host', ADDRESSES[0]), first='')
    viewer = on_host(1, 'LOCALHOST', '-c', VIEWER, ADDRESSES[0], str(view.port()), *sys.path)
    assert viewer.exit_code() == 0
    late = [*map(float, viewer.output.split())]
    assert len(late) > 20
    assert max(late[-20:]) < 2.0
