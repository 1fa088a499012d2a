"""ROS on loopback only, no test that hangs, the same examples in each run."""

import os
from pathlib import Path

from puretf._text.distribution import rclpy_version

os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'  # before rclpy starts
# Fast DDS 3, which comes with rclpy 9, warns of the name that Fast DDS 2 knows.
os.environ['FASTDDS_DEFAULT_PROFILES_FILE' if int(rclpy_version().split('.')[0] or 0) >= 9 else
           'FASTRTPS_DEFAULT_PROFILES_FILE'] = str(
               Path(__file__).parent / 'support' / 'fast_discovery.xml')

from collections.abc import Callable, Iterator
import faulthandler
import logging
import signal

from hypothesis import HealthCheck, settings
import pytest

#: Where the stacks of a test that hangs are printed, before its process exits.
_stderr = 2

# Examples have no deadline, since the machine may be busy. They are the same in each run: a fault
# that was there before must not fail a later change. --hypothesis-profile=random draws others.
_UNHURRIED = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile('short', _UNHURRIED, derandomize=True, max_examples=25)
settings.register_profile('random', _UNHURRIED, max_examples=500)
settings.load_profile('short')


def pytest_configure() -> None:
    """Keep stderr, before pytest captures it; heed Ctrl-C, which tests send to their processes."""
    global _stderr
    _stderr = os.dup(2)
    # In the background of a shell, SIGINT is ignored, also by all processes that are started.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_runtest_logstart(nodeid: str) -> None:
    """Watch for a test that hangs: no wait is longer than a minute, except in long tests."""
    seconds = 1800.0 if nodeid.startswith('test/long/') else 600.0
    faulthandler.dump_traceback_later(seconds, exit=True, file=_stderr)


def pytest_runtest_logfinish() -> None:
    """The test has ended."""
    faulthandler.cancel_dump_traceback_later()


@pytest.fixture
def logs() -> Iterator[list[logging.LogRecord]]:
    """
    The warnings that our packages log where there is no ROS.

    This fixture has its own handler: with the pytest plugins of launch, `caplog` records nothing,
    since launch replaces the class of loggers by one whose loggers do not propagate.
    """
    records: list[logging.LogRecord] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: records.append(record)  # type: ignore[method-assign]
    loggers = [*map(logging.getLogger, ('puretf', 'puretf_tools'))]
    for logger in loggers:
        logger.addHandler(handler)
    yield records
    for logger in loggers:
        logger.removeHandler(handler)


@pytest.fixture
def show(capsys: pytest.CaptureFixture[str]) -> Callable[[str], None]:
    """Print a figure that a test has measured, by `show(text)`, also if the test passes."""
    def print_line(text: str) -> None:
        with capsys.disabled():
            print(f'\n    {text}', end=' ', flush=True)

    return print_line


@pytest.fixture
def failed(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Call a `main` that fails, by `failed(main, 'argument', …)`; return exit code, stderr."""
    def call(main: Callable[[list[str]], int], *arguments: str) -> tuple[int, str]:
        code: object
        try:
            code = main([*arguments])
        except SystemExit as end:
            code = end.code
        output, error = capsys.readouterr()
        assert not output
        assert isinstance(code, int)
        return code, error

    return call
