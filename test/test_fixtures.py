"""What the other tests rely on: a domain without others, and that nothing goes on."""

import os
import signal
import subprocess
import sys

from conftest import ARM, Process
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
