"""Signals to commands at many times, of which test/commands/test_cli.py has samples; hangs."""

import os
from pathlib import Path
import re
import signal
import struct
import time

from processes import ARM, BEGUN, tool
import pytest


@pytest.mark.parametrize('delay', [i / 1000 for i in range(0, 24, 3)])
@pytest.mark.parametrize('command', [
    ('dummy_arm', '--ros-args', '-p', 'rate:=10000'), ('tf2_monitor',)])
def test_two_signals_are_a_normal_end(start, command, delay):
    """The second signal comes at any time of the cleanup."""
    for numbers in (signal.SIGINT, signal.SIGTERM), (signal.SIGTERM, signal.SIGINT):
        process = start(*tool(*command))
        process.line()
        os.kill(process.pid, numbers[0])
        time.sleep(delay)
        process.end_normally(numbers[1])
        assert 'ignored' not in process.output


@pytest.mark.parametrize('delay', [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 0.9, 1.2])
@pytest.mark.parametrize('command', [
    ('view_frames', '-t', '0.5'), ('tf_doctor', '--time', '0.5'), ('param', 'nobody'),
    ('tf_trajectory', 'map', 'odom', '--time', '0.5', '-o', 'arm.csv')])
def test_a_signal_at_any_time_is_no_traceback(start, tmp_path, command, delay):
    """The command may be importing, starting or listening; no file is left."""
    for number in signal.SIGINT, signal.SIGTERM:
        option, code, *arguments = tool(*command)
        process = start(option, BEGUN + code, *arguments, cwd=tmp_path)
        process.line_with('begun')
        time.sleep(delay)
        process.end(number)
        assert process.exit_code() in (0, 1)
        assert not re.search('Traceback|ignored', process.output)
        assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize('content', [b'', bytes(4096), b'\1' + bytes(52399)])
def test_an_unfinished_port_of_fast_dds_does_not_stop_a_command(start, domain_id, content):
    """
    Plain rclpy hangs at such a file, and neither Ctrl-C nor SIGTERM ends it.

    This is a long test, since any other command may remove the file, and say so in its output.
    """
    port = Path(f'/dev/shm/fastrtps_port{7400 + 250 * domain_id + 11}')
    port.write_bytes(content)
    os.utime(port, (0, 0))
    try:
        start(*ARM).line_with('publishing map -> base_link')
    finally:
        port.unlink(missing_ok=True)


def test_a_lock_that_a_killed_process_has_left_does_not_stop_an_end(start, domain_id):
    """
    The command ends normally, or if Fast DDS waits for the lock, by force.

    The lock is the last mutex that is shared by processes (0x80) in the file of the port.
    """
    port = Path(f'/dev/shm/fastrtps_port{7400 + 250 * domain_id + 11}')
    for _ in range(20):  # it waits in most runs
        process = start(*ARM)
        process.line_with('publishing map -> base_link')
        content = port.read_bytes()
        unlocked = struct.pack('5I', 0, 0, 0, 0, 0x80)
        place = max(i for i in range(0, len(content), 8) if content.startswith(unlocked, i))
        with port.open('r+b') as file:
            file.seek(place)
            file.write(struct.pack('4I', 2, 0, 2**22, 1))
        process.end(signal.SIGTERM)
        code = process.exit_code()
        assert code in (0, 1)
        if code:
            assert 'Timeout (0:00:05)!' in process.output
            return
    pytest.fail('Fast DDS has never waited')
