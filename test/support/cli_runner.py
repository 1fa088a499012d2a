"""Commands that are called in the process of the tests, and an arm that they can read."""

from collections.abc import Callable, Iterator, Sequence
import os
import signal
import sys
import threading
from typing import Any, IO, NamedTuple

from participants import destroy_newest
from processes import ARM, open_terminal, Process, reserved_domain, TIMEOUT
import pytest
from ros_node import eventually

from puretf_tools.cli.signals import forget_signals


class Result(NamedTuple):
    """What a command has done."""

    code: int
    stdout: str
    stderr: str


class Output:
    """A file descriptor whose text goes to a pipe or terminal, and is read by a thread."""

    def __init__(self, number: int, columns: int, has_written: Callable[[], None]) -> None:
        """
        Redirect a file descriptor, and the stream of `sys` that belongs to it.

        :param number: 1 for stdout, 2 for stderr.
        :param columns: the width of the terminal; 0: no terminal, but a pipe.
        :param has_written: called after each piece of text.
        """
        self.text = ''
        self._number, self._has_written = number, has_written
        reading, writing = open_terminal(columns) if columns else os.pipe()
        self._saved = os.dup(number)
        os.dup2(writing, number)
        os.close(writing)
        self._name = 'stdout' if number == 1 else 'stderr'
        self._stream: IO[str] = getattr(sys, self._name)
        setattr(sys, self._name, os.fdopen(os.dup(number), 'w', encoding='utf-8'))
        self._thread = threading.Thread(target=self._read, args=[reading])
        self._thread.start()

    def _read(self, reading: int) -> None:
        try:
            while data := os.read(reading, 65536):
                self.text += data.decode(errors='replace')
                self._has_written()
        except OSError:  # the terminal is closed
            pass
        os.close(reading)

    def restore(self) -> None:
        """Undo the redirection."""
        getattr(sys, self._name).close()
        setattr(sys, self._name, self._stream)
        os.dup2(self._saved, self._number)
        os.close(self._saved)
        self._thread.join()


def call(main: Callable[[Sequence[str]], int], *arguments: str, domain: int = 0,
         until: Callable[[str], object] = lambda text: False, columns: int = 0) -> Result:
    """
    Call a command in this process, as click's CliRunner does.

    It must be called in the main thread, since a command sets signal handlers. While a test has no
    context of rclpy but those of its own, the command may open and close the default one.

    :param main: the function `main` of a command.
    :param arguments: the command line.
    :param domain: the ROS domain id.
    :param until: called with the output so far, from stdout and stderr; if it returns a true
        value, Ctrl-C is pressed.
    :param columns: the width of the terminal to which the command writes; 0: it writes to pipes.
    """
    is_over = threading.Event()
    lock = threading.Lock()

    def press_ctrl_c() -> None:
        with lock:
            if not is_over.is_set():
                is_over.set()
                os.kill(os.getpid(), signal.SIGINT)

    def look() -> None:
        if len(outputs) == 2 and until(outputs[0].text + outputs[1].text):
            press_ctrl_c()

    before = signal.signal(signal.SIGINT, lambda *_: None)
    watch = threading.Timer(TIMEOUT, press_ctrl_c)
    watch.start()
    outputs: list[Output] = []
    code: Any = None
    try:
        for number in 1, 2:
            outputs.append(Output(number, columns, look))
        try:
            with pytest.MonkeyPatch.context() as patch:
                patch.setenv('ROS_DOMAIN_ID', str(domain))
                patch.setattr('puretf_tools.cli.node.destroy', destroy_newest)
                # It would end the tests if this machine is slow.
                patch.setattr('puretf_tools.cli.signals._limit_end', lambda: None)
                code = main(arguments)
        except SystemExit as end:
            code = end.code
    finally:
        with lock:
            is_ended = is_over.is_set()
            is_over.set()
        watch.cancel()
        for output in outputs:
            output.restore()
        signal.signal(signal.SIGINT, before)
        forget_signals()  # a later wait in this process would end at once
    # rcl prints these if an earlier test left a node of this name in the process, and if Ctrl-C
    # comes when a line that `until` waits for is printed and not yet sent to /rosout.
    stderr = ''.join(line for line in outputs[1].text.splitlines(keepends=True)
                     if '[rcl.logging_rosout]: Publisher already registered' not in line
                     and 'Failed to publish log message to rosout: ' not in line)
    result = Result(code, outputs[0].text, stderr)
    assert not is_ended or until(result.stdout + result.stderr), f'waited in vain: {result}'
    return result


def once(condition: Callable[[], object]) -> Callable[[str], bool]:
    """Return an `until` for `call`: a condition is waited for, and need not hold later."""
    def wait(_: str) -> bool:
        if not has_held:
            eventually(condition)
            has_held.append(True)
        return True

    has_held: list[bool] = []
    return wait


@pytest.fixture(scope='session')
def arm_domain() -> Iterator[int]:
    """
    The ROS domain of an arm that runs while this worker of pytest does.

    Tests must only read there: what they publish would reach the others.
    """
    for domain in reserved_domain():
        arm = Process(domain, *ARM)
        yield domain
        arm.close()
