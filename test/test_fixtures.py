"""The fixtures of conftest.py: isolated domains, processes that end, the marker no_ros."""

import os
from pathlib import Path
import signal
import subprocess
import sys

from conftest import ARM, needs_ros, Process
import pytest


def test_another_process_that_publishes_in_the_domain_is_named(ros):
    """Otherwise, a test could mistake messages of a process that was left behind for its own."""
    with subprocess.Popen(
            [sys.executable, *ARM], stderr=subprocess.DEVNULL,
            env={**os.environ, 'ROS_DOMAIN_ID': str(ros.context.get_domain_id())}) as arm:
        try:
            named = [f'/dummy_arm of process {arm.pid & 0xffff}']
            ros.until(lambda: ros.foreign_publishers() == named)
            with pytest.raises(AssertionError, match=r'in vain; in the domain \d+ of this test, '):
                ros.until(lambda: False, 0.1)
        finally:
            arm.send_signal(signal.SIGINT)
    ros.until(lambda: not ros.foreign_publishers())


def test_what_a_process_has_left_behind_is_ended(domain_id):
    """For example, a launch file may leave the arm running."""
    process = Process(domain_id, '-c', (
        'import subprocess, sys\n'
        'subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])\n'))
    process._popen.wait()
    assert process.has_left_processes()
    process.close()
    assert not process.has_left_processes()


@pytest.mark.parametrize(('module', 'is_needed'), [
    ('test_buffer_core', False), ('test_bag', False), ('test_view', False),
    ('test_buffer', True),  # it imports modules of ROS
    ('test_limits', True),  # it imports a name of dummy_arm.tf that is imported lazily
    ('test_rclpy_private', True)])
def test_modules_that_need_ros_are_recognised(module, is_needed):
    """A test module needs ROS if one of its imports does, directly or indirectly."""
    assert needs_ros(Path(__file__).with_name(f'{module}.py')) is is_needed


def test_a_test_without_a_domain_is_marked(request):
    """A test that reserves no domain has the marker no_ros, unless its module needs ROS."""
    assert ('no_ros' in request.keywords) is not needs_ros(request.path)


def test_a_test_with_a_domain_is_not_marked(request, domain_id):
    """A test that reserves a domain starts programs that need ROS."""
    assert 'no_ros' not in request.keywords
