"""The helpers of these tests: isolated domains, processes that end, commands that are called."""

import os
import signal
import subprocess
import sys

from cli_runner import call
from environment import ROOT
from processes import ARM, is_running, Process, reserved_domain
import pytest
from ros_node import eventually, Ros
from rosgraph_msgs.msg import Clock

from dummy_arm.dummy_arm import main
from puretf_tools.cli.signals import signal_received


def test_another_process_that_publishes_in_the_domain_is_named(ros):
    """Otherwise, a test could mistake messages of a process that was left behind for its own."""
    with subprocess.Popen(
            [sys.executable, *ARM], stderr=subprocess.DEVNULL,
            env={**os.environ, 'ROS_DOMAIN_ID': str(ros.domain)}) as arm:
        try:
            named = [f'/dummy_arm of process {arm.pid & 0xffff}']
            ros.until(lambda: ros.foreign_publishers() == named)
            with pytest.raises(AssertionError, match=r'^Waited in vain\. In the domain '):
                ros.until(lambda: False, 0.1)
        finally:
            arm.send_signal(signal.SIGINT)
    ros.until(lambda: not ros.foreign_publishers())


def test_a_domain_that_another_process_uses_is_left_to_it(monkeypatch):
    reservations = [reserved_domain(), reserved_domain()]
    domain, other = map(next, reservations)
    reservations.clear()  # both are free again
    monkeypatch.setattr('processes.random.sample', lambda *_: [domain, other])
    assert next(reserved_domain()) == domain
    process = Ros(domain)
    assert next(reserved_domain()) == other
    process.close()


def test_what_a_process_has_left_behind_is_ended(domain_id):
    """For example, a launch file may leave the arm running."""
    process = Process(domain_id, '-c', (
        'import subprocess, sys\n'
        'child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])\n'
        'print(child.pid)\n'))
    child = int(process.line())
    assert is_running(child)
    process.close()
    assert not process.has_left_processes()
    assert not is_running(child)


def test_processes_end_when_the_process_of_the_tests_dies():
    """For example, an arm would run on after a segmentation fault of a worker of pytest-xdist."""
    code = ('import os, signal, sys\n'
            'sys.path.append("test/support")\n'
            'from processes import Process\n'
            'print(Process(0, "-c", "import time; time.sleep(600)").pid, flush=True)\n'
            'os.kill(os.getpid(), signal.SIGKILL)\n')
    done = subprocess.run([sys.executable, '-c', code], cwd=ROOT, stdout=subprocess.PIPE,
                          text=True, check=False)
    assert done.returncode == -signal.SIGKILL
    eventually(lambda: not is_running(int(done.stdout)))


def test_a_command_that_is_called_leaves_the_node_of_the_test_its_discovery(ros, stranger):
    """The command detaches the discovery listener of its own participant only."""
    assert call(main, domain=ros.domain, until=lambda text: 't = 0' in text).code == 0
    assert not signal_received()
    stranger.node.create_publisher(Clock, '/clock', 1)
    ros.until(lambda: ros.node.count_publishers('/clock'))
