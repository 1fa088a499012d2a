"""check_arm in rare cases: busy domains, Ctrl-C at any time, a middleware that hangs."""

from contextlib import ExitStack, suppress
import os
from pathlib import Path
import signal
import socket
import time

from processes import tool
import pytest

from dummy_arm.grading.records import DOMAINS


def test_busy_domains_are_waited_for(start, tmp_path):
    """If all domains are in use, no program fails for it."""
    (tmp_path / 'fast.py').write_text('pass')
    with ExitStack() as stack:
        for domain in DOMAINS:
            reservation = stack.enter_context(socket.socket(socket.AF_UNIX))
            with suppress(OSError):  # another check_arm has reserved it
                reservation.bind(f'\0dummy_arm.check_arm.{domain}')
        process = start(*tool('check_arm', 'fast.py'), cwd=tmp_path)
        time.sleep(3.0)
        assert not process.has_ended()
    assert process.line_with('fast.py: not ok: It ended by itself')


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
    (tmp_path / 'arm.py').write_text('pass')
    ports = [Path(f'/dev/shm/fastrtps_port{7400 + 250 * domain + 11}') for domain in DOMAINS]
    try:
        for port in ports:
            Path(f'{port}_el').unlink(missing_ok=True)  # by an old one, Fast DDS knows better
            port.touch()
            os.utime(port, 2 * (time.time() + 3600,))
        process = start(*tool('check_arm', 'arm.py'), cwd=tmp_path)
        assert process.exit_code(120.0) == 1
        assert process.output == ('arm.py: not judged: The process that runs and observes it '
                                  'has said nothing for 75 s: probably the middleware hangs.\n')
    finally:
        for port in ports:
            port.unlink(missing_ok=True)
