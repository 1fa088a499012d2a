"""What the other tests rely on: a domain without others, and that nothing goes on."""

import os
from pathlib import Path
import signal
import subprocess
import sys

from conftest import ARM, needs_ros, Process
import pytest


def test_another_process_that_publishes_in_the_domain_is_named(ros):
    """As one that was left behind: else its messages would be taken for the test's."""
    with subprocess.Popen(
            [sys.executable, *ARM], stderr=subprocess.DEVNULL,
            env={**os.environ, 'ROS_DOMAIN_ID': str(ros.context.get_domain_id())}) as arm:
        try:
            named = [f'/dummy_arm of process {arm.pid & 0xffff}']
            ros.until(lambda: ros.strangers() == named)
            with pytest.raises(AssertionError, match=r'in vain; in the domain \d+ of this test, '):
                ros.until(lambda: False, 0.1)
        finally:
            arm.send_signal(signal.SIGINT)
    ros.until(lambda: not ros.strangers())


def test_what_a_process_has_left_behind_is_ended(domain_id):
    """As an arm that a launch file has started."""
    process = Process(domain_id, '-c', (
        'import subprocess, sys\n'
        'subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])\n'))
    process._popen.wait()
    assert process.has_left_others()
    process.close()
    assert not process.has_left_others()


@pytest.mark.parametrize(('module', 'is_needed'), [
    ('test_buffer_core', False), ('test_bag', False), ('test_view', False),
    ('test_buffer', True),  # by what it imports
    ('test_limits', True),  # by a name of dummy_arm.tf that is imported when it is asked for
    ('test_rclpy_private', True)])
def test_modules_that_need_ros_are_told(module, is_needed):
    """By their imports, and those of what they import."""
    assert needs_ros(Path(__file__).with_name(f'{module}.py')) is is_needed


def test_a_test_without_a_domain_is_marked(request):
    """Unless its module needs ROS."""
    assert ('no_ros' in request.keywords) is not needs_ros(request.path)


def test_a_test_with_a_domain_is_not_marked(request, domain_id):
    """It starts programs of ROS."""
    assert 'no_ros' not in request.keywords
