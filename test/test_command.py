"""What all commands share: arguments, errors, exit codes."""

import argparse
import shlex
import signal
import subprocess
import sys
import time

from conftest import on_linux, on_unix
import pytest

from dummy_arm.cli.parser import CommandError, number, Parser, run, UsageError


@pytest.fixture
def parser():
    """A parser with an option and positional arguments that are numbers."""
    parser = Parser('tool', 'It does nothing.', 'example: tool -1')
    parser.add_argument('--value', type=number)
    parser.add_argument('numbers', nargs='*', type=number)
    return parser


@pytest.mark.parametrize('text', ['-1', '-1.5', '-.5', '-1e-3', '-1E+3', '-.5e2', '1e3', '+2'])
def test_numbers_parse_anywhere(parser, text):
    """Options and positional arguments accept them; argparse itself takes -1e-3 for an option."""
    assert parser.parse_args(['--value', text]).value == float(text)
    assert parser.parse_args([f'--value={text}', text, text]).numbers == [float(text)] * 2


@pytest.mark.parametrize('text', ['1_0', '1.0abc', '', 'x', '1,5', 'nan', '-inf', '0x1'])
def test_other_text_is_no_number(text):
    """This includes text that float() accepts."""
    with pytest.raises(argparse.ArgumentTypeError, match=r'is not a number|is not finite'):
        number(text)


@pytest.mark.parametrize(('outcome', 'code', 'stderr'), [
    (0, 0, ''), (1, 1, ''), (UsageError('so not'), 2, 'tool: so not\n'),
    (CommandError('it broke'), 1, 'tool: it broke\n'), (KeyboardInterrupt(), 0, ''),
])
def test_exit_codes(parser, capsys, outcome, code, stderr):
    """The code is 0 after success or Ctrl-C, 1 if the command failed, 2 if it was misused."""
    def command(value, numbers, ros_args):
        assert (value, numbers) == (None, [-1.0])
        assert ros_args == ['tool', '-1', '--ros-args', '-r', 'a:=b']
        if isinstance(outcome, BaseException):
            raise outcome
        return outcome

    assert run(parser, command, ['-1', '--ros-args', '-r', 'a:=b']) == code
    assert capsys.readouterr() == ('', stderr)


@pytest.mark.parametrize('error', [CommandError, UsageError])
def test_an_error_is_one_line_that_does_not_control_the_terminal(parser, capsys, error):
    """An error may contain any name of a file, a frame or a topic."""
    def command(**_):
        raise error('no frame \x1b[2J, \r\n\u2028\udc80')

    assert run(parser, command, []) != 0
    assert capsys.readouterr().err == 'tool: no frame \\x1b[2J, \\r\\n\\u2028\\udc80\n'


def test_a_wrong_argument_does_not_control_the_terminal(failed, parser):
    """The errors of the parser are escaped, too."""
    code, line = failed(lambda args: run(parser, lambda **_: 0, args), '--\x1b[2J\n')
    assert code == 2
    assert line.startswith('tool: unrecognized arguments: --\\x1b[2J\\n; usage: tool ')


def test_two_double_dashes(failed):
    """Old versions of argparse drop the second one, and set an argument to []."""
    parser = Parser('tool', 'It does nothing.')
    parser.add_argument('frame')
    parser.add_argument('other')
    code, line = failed(lambda args: run(parser, lambda **_: 0, args), 'map', '--', '--')
    assert code == 2
    assert line.startswith('tool: -- can be given only once; usage: tool ')
    assert run(parser, lambda frame, other, **_: (frame, other) == ('-a', '-b') and 7,
               ['--', '-a', '-b', '--ros-args', '-r', 'a:=b', '--']) == 7


@on_unix
def test_a_closed_pipe_is_no_error():
    """This happens when the output is piped to `head`."""
    code = ('import sys; from dummy_arm.cli.parser import Parser, run; sys.exit(run('
            'Parser("tool", ""), lambda ros_args: [print("line") for _ in range(100000)] and 0))')
    process = subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stderr is not None
    assert process.stdout.readline() == b'line\n'
    process.stdout.close()
    assert process.stderr.read() == b''
    assert process.wait() == 0
    process.stderr.close()


@on_unix
@pytest.mark.parametrize(('redirection', 'code', 'stderr'), [
    pytest.param('> /dev/full', 1, 'tool: [Errno 28] No space left on device\n', marks=on_linux),
    ('>&-', 0, '')])
def test_output_that_goes_nowhere(redirection, code, stderr):
    """A full disk is an error of one line; a closed stdout is no error."""
    program = ('import sys; from dummy_arm.cli.parser import Parser, run; sys.exit(run('
               'Parser("tool", ""), lambda ros_args: print("line") or 0))')
    done = subprocess.run(
        f'{shlex.quote(sys.executable)} -c {shlex.quote(program)} {redirection}', shell=True,
        text=True, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (code, stderr)


@on_unix
def test_a_second_signal_ends_a_command_that_ignores_the_first():
    """The first signal is only recorded, so that nothing is left half done."""
    program = (
        'import sys, time; from dummy_arm.cli.parser import Parser, run\n'
        'def command(ros_args):\n'
        '    print("begun", flush=True)\n'
        '    while True:\n'
        '        time.sleep(0.01)\n'
        'sys.exit(run(Parser("tool", ""), command))')
    process = subprocess.Popen([sys.executable, '-c', program], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b'begun\n'
    process.send_signal(signal.SIGTERM)
    time.sleep(0.3)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    assert process.wait(20) == 0
    process.stdout.close()


@on_unix
def test_a_second_signal_does_not_interrupt_the_cleanup():
    """The third signal does, in case the cleanup hangs."""
    program = (
        'import os, signal\n'
        'from dummy_arm.cli.signals import begin_cleanup, record_signals\n'
        'record_signals()\n'
        'os.kill(os.getpid(), signal.SIGINT)\n'
        'begin_cleanup()\n'
        'os.kill(os.getpid(), signal.SIGTERM)\n'
        'print("cleaned up", flush=True)\n'
        'try:\n'
        '    os.kill(os.getpid(), signal.SIGINT)\n'
        'except KeyboardInterrupt:\n'
        '    print("interrupted")')
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True,
                          check=True, timeout=60)
    assert done.stdout == 'cleaned up\ninterrupted\n'


FAILING = """
import sys
from dummy_arm.cli.parser import Parser, run
from dummy_arm.cli.signals import sleep
from dummy_arm.cli.node import run_node, spinning_node
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

def fail():
    raise ZeroDivisionError('of a callback')
"""


def test_a_command_ends_when_its_node_stops(start):
    """It prints one line: its further output would be out of date."""
    process = start('-c', FAILING + """
def command(ros_args):
    with spinning_node('tool', ros_args) as node:
        node.create_timer(0.01, fail)
        while True:
            sleep(60)
sys.exit(run(Parser('tool', ''), command))
""")
    assert process.exit_code() == 1
    assert process.output == ('tool: the node stopped, because its executor raised '
                              'ZeroDivisionError: of a callback\n')


def test_a_node_that_fails_is_destroyed(start):
    """The node is destroyed before the error is raised to the caller."""
    process = start('-c', FAILING + """
nodes = []
def make():
    nodes.append(Node('tool'))
    nodes[0].create_timer(0.01, fail)
    return nodes[0]
try:
    run_node(make, ['tool'])
except ZeroDivisionError:
    try:
        with nodes[0].handle:
            print('alive')
    except InvalidHandle:
        print('destroyed')
""")
    assert process.exit_code() == 0
    assert process.output == 'destroyed\n'
