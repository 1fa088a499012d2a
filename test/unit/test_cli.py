"""What all commands share, without ROS: arguments, errors, exit codes, signals, files, waits."""

import argparse
from collections.abc import Callable
import gc
import io
import os
import shlex
import signal
import subprocess
import sys

from environment import on_linux, on_unix
from processes import tool_without_ros
import pytest

from puretf.bag import BagError
from puretf_tools import entry_points
from puretf_tools.cli import progress, signals
from puretf_tools.cli.bag_options import add_bag_options, bag_progress
from puretf_tools.cli.files import path_to_write, whole_file
from puretf_tools.cli.parser import CommandError, number, Parser, run, UsageError
from puretf_tools.cli.signals import (
    begin_cleanup,
    check_signals,
    forget_signals,
    record_signals,
    signal_received,
)
from puretf_tools.cli.times import when

SIGNALS = signal.SIGINT, signal.SIGTERM


@pytest.fixture(autouse=True)
def handlers(monkeypatch):
    """Restore the signal handlers after each test; forget what was recorded."""
    monkeypatch.setattr(signals, '_limit_end', lambda: None)  # it would end the tests
    before = {each: signal.getsignal(each) for each in SIGNALS}
    yield
    for each, handler in before.items():
        signal.signal(each, handler)
    forget_signals()
    gc.unfreeze()


@pytest.fixture
def parser():
    """A parser with an option and positional arguments that are numbers."""
    parser = Parser('tool', 'It does nothing.', 'example: tool -1')
    parser.add_argument('--value', type=number)
    parser.add_argument('numbers', nargs='*', type=number)
    return parser


# Arguments


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


@pytest.mark.parametrize(('argument', 'hint'), [
    ('--val=1', '(did you mean --value?)'), ('--vlaue', '(did you mean --value?)'),
    ('--\x1b[2J\n', '--\\x1b[2J\\n'), ('--xyz', '--xyz')])
def test_a_wrong_option_is_one_line_with_a_hint(failed, parser, argument, hint):
    """Options cannot be abbreviated, and do not control the terminal."""
    code, line = failed(lambda args: run(parser, lambda **_: 0, args), argument)
    assert code == 2
    assert line.startswith('tool: unrecognized arguments: --')
    assert line.endswith(f'{hint}; usage: tool [-h] [--value VALUE] [numbers ...]\n')


def test_ros_arguments_and_double_dashes():
    """ROS arguments end at `--`."""
    parser = Parser('tool', 'It does nothing.')
    parser.add_argument('frame')
    parser.add_argument('other')
    assert run(parser, lambda frame, other, **_: (frame, other) == ('a', 'b') and 7, [
        'a', '--ros-args', '-r', 'c:=d', '--', 'b', '--ros-args', '-p', 'e:=f']) == 7
    assert run(parser, lambda frame, other, **_: (frame, other) == ('-a', '-b') and 7,
               ['--', '-a', '-b', '--ros-args', '-r', 'a:=b', '--']) == 7


# Ends


@pytest.mark.parametrize(('outcome', 'code', 'stderr'), [
    (0, 0, ''), (1, 1, ''), (UsageError('so not'), 2, 'tool: so not\n'),
    (CommandError('it broke'), 1, 'tool: it broke\n'), (KeyboardInterrupt(), 5, ''),
])
def test_exit_codes(parser, capsys, outcome, code, stderr):
    """The code is 1 if the command failed, 2 if it was misused; that of Ctrl-C is its own."""
    def command(value, numbers, ros_args):
        assert (value, numbers) == (None, [-1.0])
        assert ros_args == ['tool', '-1', '--ros-args', '-r', 'a:=b']
        if isinstance(outcome, BaseException):
            raise outcome
        return outcome

    before = signal.getsignal(signal.SIGTERM)
    assert run(parser, command, ['-1', '--ros-args', '-r', 'a:=b'], interrupted=5) == code
    assert capsys.readouterr() == ('', stderr)
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize('error', [CommandError, UsageError])
def test_an_error_is_one_line_that_does_not_control_the_terminal(parser, capsys, error):
    """An error may contain any name of a file, a frame or a topic."""
    def command(**_):
        raise error('no frame \x1b[2J, \r\n\u2028\udc80')

    assert run(parser, command, []) != 0
    assert capsys.readouterr().err == 'tool: no frame \\x1b[2J, \\r\\n\\u2028\\udc80\n'


def program(command):
    """Return the arguments with which python runs a command; `command` is its expression."""
    return [sys.executable, '-c', 'import sys, time; from puretf_tools.cli.parser import '
            f'Parser, run; sys.exit(run(Parser("tool", ""), lambda ros_args: {command}, '
            'interrupted=3))']


@on_unix
@pytest.mark.parametrize(('redirection', 'code', 'stderr'), [
    pytest.param('> /dev/full', 1, 'tool: [Errno 28] No space left on device\n', marks=on_linux),
    ('>&- 2>&-', 0, '')])
def test_output_that_goes_nowhere(redirection, code, stderr):
    """A full disk is an error of one line; closed streams are no error."""
    command = shlex.join(program('print("line") or sys.stderr.write("2") and 0'))
    done = subprocess.run(f'{command} {redirection}', shell=True, text=True, capture_output=True,
                          check=False)
    assert (done.returncode, done.stderr) == (code, stderr)


@on_unix
def test_a_line_is_written_at_once_and_a_second_signal_ends_a_command():
    """Of a line, no character is lost. The first signal is only recorded."""
    with subprocess.Popen(
            program('[print("\\u65e5", sys.argv)] and [time.sleep(0.01) for _ in iter(int, 1)]'),
            stdout=subprocess.PIPE, env={**os.environ, 'PYTHONIOENCODING': 'ascii'}) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"\\u65e5 ['-c']\n"
        for each in signal.SIGTERM, signal.SIGINT:
            process.send_signal(each)
        assert process.wait() == 3


def test_a_module_that_is_missing(monkeypatch, capsys):
    """Only if it is one of ROS, the error has the remedy."""
    class Module:
        @property
        def main(self) -> None:
            raise ModuleNotFoundError(name=name)

    monkeypatch.setitem(sys.modules, 'puretf_tools.commands.param', Module())
    name = 'geometry_msgs'
    assert entry_points.param() == 1
    assert gc.get_freeze_count()  # at the exit, Python looks for no garbage
    assert capsys.readouterr().err.startswith(
        'param: this command needs ROS, but geometry_msgs cannot be imported: pip install ')
    name = 'numpy'
    with pytest.raises(ModuleNotFoundError):
        entry_points.param()


# Signals


def interrupts(number):
    """Send a signal to this process, and return whether it raises KeyboardInterrupt at once."""
    try:
        signal.raise_signal(number)
    except KeyboardInterrupt:
        return True
    return False


def test_the_first_signal_is_recorded():
    """The next check raises KeyboardInterrupt; the second signal does at once."""
    before = {each: signal.getsignal(each) for each in SIGNALS}
    assert record_signals() == before
    check_signals()
    assert not signal_received()
    assert not interrupts(signal.SIGTERM)
    assert signal_received()
    assert record_signals() == {}
    with pytest.raises(KeyboardInterrupt):
        check_signals()
    assert interrupts(signal.SIGINT)


def test_a_second_signal_does_not_interrupt_the_cleanup():
    """The third signal ends it, in case it hangs: see below."""
    record_signals()
    assert not interrupts(signal.SIGINT)
    begin_cleanup()
    assert not interrupts(signal.SIGTERM)


@pytest.mark.parametrize('forget', [forget_signals, lambda: signal.signal(
    signal.SIGINT, signal.SIG_DFL) and record_signals()])
def test_signals_are_forgotten(forget):
    """A command that goes on begins anew, also a command that is called after another one."""
    record_signals()
    begin_cleanup()
    assert not interrupts(signal.SIGINT)
    forget()
    assert not signal_received()
    assert not interrupts(signal.SIGINT)
    assert interrupts(signal.SIGINT)


LAST_RESORT = """if True:
    import atexit, ctypes, gc, signal, sys, threading, time, types
    from puretf_tools import entry_points
    from puretf_tools.cli import signals
    from puretf_tools.cli.signals import begin_cleanup, end_cleanup, record_signals

    signals._LONGEST_END = 1

    def send(count):
        for _ in range(count):
            signal.raise_signal(signal.SIGTERM)

    def run(main):
        module = sys.modules['puretf_tools.commands.param'] = types.ModuleType('param')
        module.main = main
        sys.exit(entry_points.param())

    """


def ended(code):
    """Run code after that of `LAST_RESORT`; return its exit code, stdout and stderr."""
    result = subprocess.run([sys.executable, '-c', LAST_RESORT + code], capture_output=True,
                            text=True, timeout=60)
    return result.returncode, result.stdout, result.stderr


@on_linux
@pytest.mark.parametrize(('hang', 'count'), [
    pytest.param('threading.Thread(target=threading.Event().wait).start()', 1, id='thread'),
    pytest.param('atexit.register(ctypes.PyDLL(None).pause)', 2, id='with the GIL'),
    pytest.param('atexit.register(ctypes.PyDLL(None).pause)', 0, id='without a signal')])
def test_an_exit_that_hangs_is_cut_short(hang, count):
    """The stacks show where it hangs; what was printed is there."""
    code, output, error = ended(f'{hang}; run(lambda: print("done") or send({count}) or 0)')
    assert (code, output) == (1, 'done\n')
    assert error.startswith('Timeout (0:00:01)!\nThread ')


@on_linux
def test_the_third_signal_ends_a_cleanup_at_once():
    """The first two may be one Ctrl-C; see `begin_cleanup`."""
    assert ended('record_signals(); begin_cleanup(); send(2); print("in it"); send(1); print("!")'
                 ) == (143, 'in it\n', '-c: ended before the cleanup was complete\n')


@on_linux
def test_a_command_that_goes_on_after_the_cleanup_has_time():
    """It may write what it has recorded; a further signal interrupts it in order."""
    assert ended("""
    record_signals(); send(1); begin_cleanup(); end_cleanup()
    time.sleep(1.3)
    try:
        send(2)
    except KeyboardInterrupt:
        print('interrupted')""") == (0, 'interrupted\n', '')


# Waits


class Clock:
    """A clock that goes on while one sleeps."""

    def __init__(self) -> None:
        """Begin long after 0, without anything that will happen."""
        self.now = 1000.0
        self.longest = 0.0
        self.happen: dict[float, Callable[[], object]] = {}

    def monotonic(self) -> float:
        """Return the time (s)."""
        return self.now

    def sleep(self, seconds: float) -> None:
        """Let time pass; what is to happen then happens, in order of time."""
        assert seconds > 0.0
        assert self.passed() < 100.0, 'it does not end'
        self.now += seconds
        self.longest = max(self.longest, seconds)
        for time in [*self.happen]:
            if time <= self.now - 1000.0:
                self.happen.pop(time)()

    def passed(self) -> float:
        """Return the time since the beginning (s)."""
        return round(self.now - 1000.0, 6)


@pytest.fixture
def clock(monkeypatch):
    """The clock of the modules that wait."""
    clock = Clock()
    for module in progress, signals:
        monkeypatch.setattr(module, 'time', clock)
    record_signals()
    return clock


def press_ctrl_c():
    """Send SIGINT to this process."""
    signal.raise_signal(signal.SIGINT)


def test_a_sleep(clock):
    """It ends in time, and at a signal."""
    signals.sleep(0.12)
    assert clock.passed() == 0.12
    clock.happen[30.0] = press_ctrl_c
    with pytest.raises(KeyboardInterrupt):
        signals.sleep(1e9)
    assert clock.passed() == pytest.approx(30.0, abs=0.1)
    assert clock.longest <= 0.1  # a signal does not end a time.sleep
    with pytest.raises(KeyboardInterrupt):
        signals.sleep(0.0)


@pytest.mark.parametrize('wait_until', [
    signals.wait_until, lambda seconds, holds: progress.wait(seconds, 'waiting', holds)])
def test_a_wait_for_a_condition(clock, wait_until):
    """It ends when the condition holds, at the latest in time, or at a signal."""
    assert wait_until(0.0, lambda: True) is True
    assert wait_until(0.12, lambda: 0) is False
    assert clock.passed() == 0.12
    assert wait_until(1e9, lambda: clock.passed() > 20.0) is True
    assert clock.passed() == pytest.approx(20.0, abs=0.1)
    clock.happen[30.0] = press_ctrl_c
    with pytest.raises(KeyboardInterrupt):
        wait_until(1e9, lambda: 0)
    assert clock.passed() == pytest.approx(30.0, abs=0.1)


@pytest.mark.parametrize(('seconds', 'first', 'ctrl_c', 'end', 'listened'), [
    pytest.param(2.0, 3.0, None, 5.0, 2.0, id='it listens after the first transform'),
    pytest.param(2.0, None, None, 7.0, 7.0, id='discovery may take 7 s'),
    pytest.param(20.0, None, None, 20.0, 20.0, id='nothing comes'),
    pytest.param(100.0, 1.0, 31.0, 31.0, 30.0, id='Ctrl-C'),
    pytest.param(100.0, None, 3.0, 3.0, 3.0, id='Ctrl-C before the first')])
def test_listening(clock, seconds, first, ctrl_c, end, listened):
    """A signal ends it without an error; it polls until the end."""
    received, polled = [], []
    if first is not None:
        clock.happen[first] = lambda: received.append(1)
    if ctrl_c is not None:
        clock.happen[ctrl_c] = press_ctrl_c
    assert progress.listen(seconds, lambda: received, lambda: polled.append(clock.passed())
                           ) == pytest.approx(listened, abs=0.11)
    assert clock.passed() == pytest.approx(end, abs=0.11)
    assert polled[0] == 0.0
    assert polled[-1] == clock.passed()
    assert len(polled) > 10 * end


def replace_stderr(monkeypatch, is_terminal):
    """Let stderr be a terminal or a pipe; return its text."""
    stderr = io.StringIO()
    monkeypatch.setattr(stderr, 'isatty', lambda: is_terminal)
    monkeypatch.setattr(sys, 'stderr', stderr)
    return stderr


@pytest.mark.parametrize(('kind', 'has_tqdm'), [
    ('terminal', True), ('terminal', False), ('pipe', True), ('closed', True)])
def test_a_bar_is_shown_on_a_terminal(monkeypatch, clock, kind, has_tqdm):
    """It is filled while time passes, and erased; there is none in a pipe or without tqdm."""
    if has_tqdm:
        tqdm = pytest.importorskip('tqdm').tqdm
        monkeypatch.setattr(tqdm, 'monitor_interval', 0)  # it would start a thread
    else:
        monkeypatch.setitem(sys.modules, 'tqdm', None)
    stderr = replace_stderr(monkeypatch, kind == 'terminal')
    if kind == 'closed':
        monkeypatch.setattr(sys, 'stderr', None)
    assert not progress.wait(3.0, 'waiting')
    assert clock.passed() == 3.0
    text = stderr.getvalue()
    if kind == 'terminal' and has_tqdm:
        assert 'waiting' in text
        assert '0.0 of 3 s' in text
        assert not text.split('\r')[-2].strip()
    else:
        assert text == ''


# Files


@on_unix
@pytest.mark.parametrize(('name', 'text'), [
    ('', 'it is not a regular file$'), ('missing/x', '.*missing is not a writable directory$'),
    ('pipe', 'it is not a regular file$')])
def test_where_no_file_can_be_written(tmp_path, name, text):
    """The check says so before the work begins; nothing is replaced."""
    os.mkfifo(tmp_path / 'pipe')
    path_to_write(f'{tmp_path}/new', [''])
    with pytest.raises(CommandError, match=rf'^cannot write .*{name}: {text}'):
        path_to_write(str(tmp_path / name), [''])
    with pytest.raises(CommandError, match=r'^cannot write '), whole_file(tmp_path / name):
        pass
    assert (tmp_path / 'pipe').is_fifo()


def test_a_file_is_written_whole(tmp_path):
    """Until the end of the block, the old file is there."""
    path = tmp_path / 'file'
    path.write_text('old')
    with whole_file(path) as part:
        part.write_text('new')
        assert part.parent == tmp_path
        assert path.read_text() == 'old'
    assert path.read_text() == 'new'
    assert [*tmp_path.iterdir()] == [path]


@pytest.mark.parametrize(('error', 'expected', 'text'), [
    (KeyboardInterrupt(), KeyboardInterrupt, ''), (CommandError('no row'), CommandError, 'no row'),
    (OSError(28, 'No space left on device'), CommandError, 'cannot write {}: No space left on d'),
    (OSError('odd'), CommandError, 'cannot write {}: odd')])
def test_or_not_at_all(tmp_path, error, expected, text):
    """No part of a new file is left, and an old file stays."""
    path = tmp_path / 'file'
    path.write_text('old')
    def write():
        with whole_file(path) as part:
            part.write_text('new')
            raise error

    with pytest.raises(expected) as raised:
        write()
    assert str(raised.value).startswith(text.format(path))
    assert path.read_text() == 'old'
    assert [*tmp_path.iterdir()] == [path]


@on_unix
def test_a_link_stays_a_link(tmp_path):
    """The file that it names is written, in its directory."""
    (tmp_path / 'there').mkdir()
    link, target = tmp_path / 'link', tmp_path / 'there' / 'file'
    link.symlink_to(target)
    for text in 'new', 'newer':
        with whole_file(link) as part:
            part.write_text(text)
            assert part.parent == target.parent
        assert link.is_symlink()
        assert target.read_text() == text


@on_unix
@pytest.mark.parametrize('mode', [0o600, 0o440, 0o751])
def test_a_file_that_is_replaced_keeps_its_mode(tmp_path, mode):
    """Until then, nobody else can read the new file, either; its user can write it."""
    path = tmp_path / 'file'
    path.touch()
    path.chmod(mode)
    with whole_file(path) as part:
        part.write_text('new')
        assert part.stat().st_mode & 0o777 == 0o600
    assert path.read_text() == 'new'
    assert path.stat().st_mode & 0o7777 == mode


@on_unix
def test_a_new_file_has_the_usual_mode(tmp_path):
    """The umask determines it."""
    before = os.umask(0o027)
    try:
        with whole_file(tmp_path / 'file') as part:
            part.write_text('new')
    finally:
        os.umask(before)
    assert (tmp_path / 'file').stat().st_mode & 0o777 == 0o640


# Bags


@pytest.fixture
def walk(bags, tmp_path):
    """The path of a bag."""
    return str(bags.file_of(bags.make(tmp_path, 'mcap', bags.walk(10))))


def read(*arguments):
    """Read the bag that some arguments name; return the buffer, or the time to listen (s)."""
    parser = Parser('tool', '')
    parser.add_argument('-t', type=when)
    add_bag_options(parser, '--time')
    options = vars(parser.parse_args(arguments))
    parser.finish(options)
    assert options.keys() == {'bag', 'namespace', 'seconds', 't'}
    if not options['bag']:
        return options['seconds']
    with options['bag'].opened() as bag:
        return bag.read()


def test_bag_options(walk):
    """They are one argument of the command; without it, there is a time to listen."""
    assert (read(), read('--time', '7', '-t', '1.5')) == (5.0, 7.0)
    with pytest.raises(CommandError, match='/robot/tf'):
        read('--bag', walk, '--namespace', 'robot')
    os.truncate(walk, os.path.getsize(walk) - 100)
    assert read('--partial', '--bag', walk, '-t', '+1').can_transform('map', 'base_link', 0)
    with pytest.raises(CommandError, match=r'^[^\n]*--partial[^\n]*$'):
        read('--bag', walk)


@pytest.mark.parametrize(('arguments', 'bag', 'frames'), [
    ('--bag {0}/a.mcap {0}/b.bag map tool', '{0}/a.mcap {0}/b.bag', 'map tool'),
    ('map tool --bag {0}/a.mcap {0}/bag', '{0}/a.mcap {0}/bag', 'map tool'),
    ('--bag={0}/a.mcap {0}/*.db3 map tool', '{0}/a.mcap {0}/*.db3', 'map tool'),
    ('--bag {0}/x --partial map {0}/a.mcap', '{0}/x', 'map {0}/a.mcap'),
    ('--bag {0}/x {0}/empty robot/map', '{0}/x {0}/empty', 'robot/map'),
    ('--bag a.mcap --bag b.mcap map', 'a.mcap b.mcap', 'map'),
    ('--bag a.mcap.zstd -- map', 'a.mcap.zstd', 'map')])
def test_several_bags_and_frames(tmp_path, arguments, bag, frames):
    """Each path after the first is another bag, and the names of frames are none."""
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'metadata.yaml').touch()
    parser = Parser('tool', '')
    parser.add_argument('frames', nargs='*')
    add_bag_options(parser)
    given = parser.parse_args(parser.prepare(arguments.format(tmp_path).split()))
    assert given.bag == bag.format(tmp_path).split()
    assert given.frames == frames.format(tmp_path).split()


@pytest.mark.parametrize(('arguments', 'error', 'text'), [
    (['--bag='], UsageError, '^--bag needs the path of a bag, got an empty one$'),
    (['--partial'], UsageError, '^--partial needs --bag$'),
    (['-t', '+1'], UsageError, '^a time with a sign counts from .* a bag: it needs --bag$'),
    (['--bag', 'x', '--time', '1'], UsageError, '^--time is for listening: leave it out with'),
    (['--bag', 'nowhere.mcap'], CommandError, r'^.*nowhere\.mcap[^\n]*$')])
def test_bags_that_are_not_read(arguments, error, text):
    """The error is of one line."""
    with pytest.raises(error, match=text):
        read(*arguments)


def fail(error):
    """Raise an error."""
    raise error


@pytest.mark.parametrize(('error', 'text'), [
    (PermissionError(13, 'Permission denied'), 'cannot read x.bag: Permission denied'),
    (OSError('odd'), 'cannot read x.bag: odd'), (BagError('odd bag'), 'odd bag')])
def test_errors_while_a_bag_is_read(error, text):
    """They are errors of the command, of one line."""
    with pytest.raises(CommandError, match=f'^{text}$'), bag_progress(['x.bag']):
        fail(error)


def test_a_signal_ends_the_reading(walk):
    """It is noticed while the bag is read."""
    record_signals()
    signal.raise_signal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        read('--bag', walk)


@pytest.mark.parametrize(('command', 'begin'), [
    ('tf2_echo map base_link', 'At time 110.000000000\n'), ('view_frames --text', 'map\n'),
    ('tf_doctor', 'not checked: '), ('tf_trajectory map base_link -o x.csv', 'wrote x.csv: ')])
def test_a_bag_without_ros(walk, tmp_path, command, begin):
    """Where stdout cannot encode the lines of the tree, as on Windows, they are replaced."""
    done = subprocess.run(
        [sys.executable, *tool_without_ros(*command.split(), '--bag', walk)], text=True,
        cwd=tmp_path, env={**os.environ, 'PYTHONIOENCODING': 'cp1252'},
        capture_output=True, check=True)
    assert (done.stdout[:len(begin)], done.stderr) == (begin, '')
