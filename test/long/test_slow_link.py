"""
The page of web_view over a slow link of 160 kbit/s, between two network namespaces.

They have no route to any other network. This needs root and iproute2, and takes a minute.
"""

import os
import subprocess
import sys

from processes import ARM, tool
import pytest

ADDRESS, OTHER = '10.78.0.1', '10.78.0.2'
#: Prints once a second by how much the frame that is shown is older than now (s).
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
#: Starts python in a network namespace.
IN_NAMESPACE = """
import os, sys
name, *arguments = sys.argv[1:]
os.execvp('ip', ['ip', 'netns', 'exec', name, sys.executable, '-u', *arguments])
"""


def ip(*arguments):
    """Run ip."""
    subprocess.run(['ip', *arguments], check=True, capture_output=True, text=True)


@pytest.fixture
def namespaces():
    """Two network namespaces with a slow link between them."""
    names = [f'slow-{os.getpid()}-{number}' for number in range(2)]
    try:
        try:
            for name in names:
                ip('netns', 'add', name)
        except (OSError, subprocess.CalledProcessError) as error:
            pytest.skip(f'no network namespace can be created: {error}')
        ip('-n', names[0], 'link', 'add', 'eth', 'type', 'veth', 'peer', 'name', 'eth', 'netns',
           names[1])
        for name, address in zip(names, (ADDRESS, OTHER)):
            ip('-n', name, 'address', 'add', f'{address}/24', 'dev', 'eth')
            for interface in 'lo', 'eth':
                ip('-n', name, 'link', 'set', interface, 'up')
            ip('netns', 'exec', name, 'tc', 'qdisc', 'add', 'dev', 'eth', 'root', 'tbf', 'rate',
               '160kbit', 'burst', '4kb', 'latency', '5s')
        yield names
    finally:
        for name in names:
            subprocess.run(['ip', 'netns', 'del', name], capture_output=True)


def test_the_picture_is_not_late(start, namespaces):
    """A queue of the updates that the link cannot carry would grow."""
    here, there = namespaces
    start('-c', IN_NAMESPACE, here, *ARM)
    view = start('-c', IN_NAMESPACE, here, *tool('web_view', '--host', ADDRESS))
    viewer = start(
        '-c', IN_NAMESPACE, there, '-c', VIEWER, ADDRESS, str(view.port()), *sys.path)
    assert viewer.exit_code() == 0
    late = [*map(float, viewer.output.split())]
    assert len(late) > 20
    assert max(late[-20:]) < 2.0
