"""check_arm in rare cases: a static arm, busy domains, a reader that has ended."""

from contextlib import ExitStack, suppress
import os
from pathlib import Path
import signal
import socket
import sys
import time

from processes import tool
import pytest

from dummy_arm.grading.records import DOMAINS


def test_an_arm_that_is_static(start):
    """If nothing is on /tf, the frames are judged all the same, and base_link is received."""
    start(*tool('static_transform_publisher', '--frame-id', 'map', '--child-frame-id',
                'base_link')).line_with('translation')
    process = start(*tool('check_arm', '--time', '1'))
    assert process.exit_code() == 1
    assert 'base_link reaches a late listener             received\n' in process.output
    assert 'No transform of joint_1 was received: nothing arrives on /tf.' in process.output


def test_busy_domains_are_waited_for(start, tmp_path):
    """If all domains are in use, no program fails for it."""
    (tmp_path / 'fast.py').write_text('')
    with ExitStack() as stack:
        for domain in DOMAINS:
            reservation = stack.enter_context(socket.socket(socket.AF_UNIX))
            with suppress(OSError):  # another check_arm has reserved it
                reservation.bind(f'\0dummy_arm.check_arm.{domain}')
        process = start(*tool('check_arm', 'fast.py'), cwd=tmp_path)
        time.sleep(3.0)
        assert not process.has_ended()
    assert process.line_with('fast.py: not ok: It ended by itself')


def test_a_closed_output(start, tmp_path):
    """If the reader of the output has ended, not all is judged: the exit code is 1."""
    for name in 'a.py', 'b.py':
        (tmp_path / name).write_text('')
    code = 'import os, subprocess, sys\n' \
           'done = subprocess.Popen(sys.argv[1:], stdout=subprocess.PIPE)\n' \
           'done.stdout.close()\nsys.exit(done.wait())\n'
    process = start('-c', code, sys.executable, '-u', *tool('check_arm', 'a.py', 'b.py'),
                    cwd=tmp_path)
    assert process.exit_code() == 1
    assert 'Traceback' not in process.output


@pytest.mark.parametrize('delay', [0.1 * i for i in range(3, 18)])
def test_ctrl_c_at_any_time(start, tmp_path, delay):
    """The process that observes the program ends with it, and nothing prints a traceback."""
    (tmp_path / 'arm.py').write_text('import time\ntime.sleep(1000)\n')
    process = start(*tool('check_arm', 'arm.py'), cwd=tmp_path)
    time.sleep(delay)
    process.end(signal.SIGINT)
    assert process.exit_code() == 1
    assert 'Traceback' not in process.output
    assert not process.has_left_processes()


def test_a_middleware_that_hangs(start, tmp_path):
    """Fast DDS hangs at the empty file of a port, which is too new to be removed: not judged."""
    (tmp_path / 'arm.py').write_text('')
    ports = [Path(f'/dev/shm/fastrtps_port{7400 + 250 * domain + 11}') for domain in DOMAINS]
    try:
        for port in ports:
            port.touch()
            os.utime(port, 2 * (time.time() + 3600,))
        process = start(*tool('check_arm', 'arm.py'), cwd=tmp_path)
        assert process.exit_code(120.0) == 1
        assert process.output == ('arm.py: not judged: The process that observes it has said '
                                  'nothing for 65 s: probably the middleware hangs.\n')
    finally:
        for port in ports:
            port.unlink(missing_ok=True)
