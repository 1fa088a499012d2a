"""The wake-up call of a waiting thread."""

import subprocess
import sys
from threading import Timer

import pytest

from puretf._core.wake import Wake

SIGNALS = """
import signal
from puretf._core.wake import Wake

signal.signal(signal.SIGALRM, lambda *_: None)
signal.setitimer(signal.ITIMER_REAL, 0.0005, 0.0005)
wake = Wake()
assert not any(wake.wait(0.0005) for _ in range(2000))
signal.setitimer(signal.ITIMER_REAL, 0.0)
"""


def test_it_wakes_once():
    """Now or later, however often it was set."""
    wake = Wake()
    assert not wake.wait(0.0)
    for _ in range(2):
        wake.set()
    assert wake.is_set()
    assert wake.wait(0.0)
    assert not wake.is_set()
    Timer(0.01, wake.set).start()
    assert wake.wait(60.0)
    assert not wake.wait(0.001)


@pytest.mark.skipif(sys.platform == 'win32', reason='Windows has no such timer')
def test_a_signal_near_the_timeout_does_not_prolong_it():
    """A `SimpleQueue` waits for ever then, after some tries, in Python up to 3.12."""
    subprocess.run([sys.executable, '-c', SIGNALS], check=True, timeout=100)
