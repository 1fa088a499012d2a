"""The program that a student has handed in: find it, refuse it or run it."""

import ast
from contextlib import suppress
from importlib.util import decode_source, find_spec
import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
import time

import dummy_arm
from puretf._text.names import abbreviated, comma_list, quoted, visible
from puretf_tools.cli.parser import CommandError
from puretf_tools.cli.signals import wait_until

#: How long to wait until a program has ended after SIGINT (s).
_GRACE = 3.0
#: The largest source, the largest output, and the largest file that a program writes (bytes).
_LONGEST_SOURCE, _LONGEST_OUTPUT, _LONGEST_FILE = 1_000_000, 100_000_000, 200_000_000
#: How much of the output is read at a time, which is many times a second (bytes).
_PART = 1_000_000
#: How much a process may hold that is not shared (bytes), with the stacks of its threads, and how
#: many files are copied.
_MOST_DATA, _MOST_COPIED = 2**32, 1000
#: Each Python that a program starts runs this first, as its `sitecustomize`: the arm of this
#: package cannot be imported.
_ITS_OWN = f"""
import sys
class Finder:
    def find_spec(name, path, target=None):
        if name in ('dummy_arm.dummy_arm', 'dummy_arm.arm') and {dummy_arm.__path__[0]!r} in path:
            raise ImportError(f'import of {{name}} halted')
sys.meta_path.insert(0, Finder)"""
#: The program that runs a program; if it does not call its main(), as `ros2 run` does, this
#: follows. SIGTERM is blocked in it: it is not for this program, if another one sends it to all,
#: as by `pkill python`. But it ends a fork; what it starts by `subprocess` inherits the block, so
#: terminate() sends SIGKILL.
_RUN = f"""
import faulthandler, os, resource, runpy, signal, subprocess, sys
for kind, most in ((resource.RLIMIT_FSIZE, {_LONGEST_FILE}), (resource.RLIMIT_CORE, 0),
                   (resource.RLIMIT_DATA, {_MOST_DATA})):
    limits = [each for each in resource.getrlimit(kind) if each >= 0]
    resource.setrlimit(kind, 2 * (min([most, *limits]),))
signal.pthread_sigmask(signal.SIG_SETMASK, [signal.SIGTERM])
os.register_at_fork(after_in_child=lambda: signal.pthread_sigmask(signal.SIG_SETMASK, []))
subprocess.Popen.terminate = subprocess.Popen.kill
faulthandler.register(signal.SIGUSR1)  # for `Program.place`
path = os.environ.pop('CHECK_ARM_PROGRAM')
sys.argv = [path]
sys.path.insert(0, os.path.dirname(path))
"""
#: It runs the program as a file, or as a module of its package `dummy_arm`.
_AS_FILE = "runpy.run_path(path, run_name='__main__')"
_AS_MODULE = """sys.path.insert(0, os.path.dirname(sys.path[0]))
runpy.run_module('dummy_arm.dummy_arm', run_name='__main__', alter_sys=True)"""
#: Why a callback is None, and why input() fails.
_CALLED = (': a function is called where it should be passed, as in create_timer(0.02, '
           'self.tick()): write self.tick')
_INPUT = ': nobody types what input() reads; leave it out'
#: How the launch files of ROS begin, as XML, YAML and Python.
_LAUNCH = re.compile(r'^\s*<launch\b|^launch:|^def generate_launch_description\(', re.MULTILINE)
_TRACEBACK = 'Traceback (most recent call last):'
#: Where dummy_arm.py lies in a folder: as such, or in a package, or in a workspace, or in the only
#: folder that has one, as in an archive that was unpacked.
_PLACES = ('', 'dummy_arm/', 'dummy_arm/dummy_arm/', 'src/dummy_arm/dummy_arm/', '*/',
           '*/src/dummy_arm/dummy_arm/')


class ProgramError(CommandError):
    """A program or its arm is not ok; the text says why."""


def how_it_ended(code: int) -> str:
    """Return how a process has ended: by a signal (negative), or with an exit code."""
    return f'by signal {-code}' if code < 0 else f'with exit code {code}'


def program_in(path: Path) -> Path:
    """Return the program of a hand-in, which is its path, or lies in this folder."""
    if not os.path.isdir(path):  # unlike Path.is_dir, it raises no error
        return path
    for place in _PLACES:
        if len(found := [*path.glob(f'{place}dummy_arm.py')]) == 1:
            return found[0]
    with suppress(OSError):
        if names := sorted(os.listdir(path)):
            raise CommandError(
                f'There is no dummy_arm.py in it, but {comma_list(names, quoted)}: unpack an '
                'archive, rename the program to dummy_arm.py, or give its path.')
    raise ProgramError('It is empty, or cannot be read.')


def _parsed(path: Path) -> ast.Module:
    """Return the syntax tree of a program; raise why it is not run."""
    try:
        with path.open('rb') as file:
            data = file.read(_LONGEST_SOURCE + 1)
    except OSError as error:
        raise ProgramError(f'It cannot be read: {error.strerror}.') from None
    if b'\0' in data:  # as in archives, and in UTF-16
        raise CommandError('It is not plain text, but probably an archive or a document: unpack '
                           'it, or save it as text in UTF-8, a .py file.')
    if len(data) > _LONGEST_SOURCE:
        raise ProgramError(f'It has more than {_LONGEST_SOURCE // 10**6} MB.')
    try:
        source = decode_source(data)
    except (SyntaxError, LookupError, UnicodeError) as error:
        raise ProgramError(
            'It is not text in UTF-8, but perhaps a PDF: hand in the source, a .py file, saved as '
            f'UTF-8 ({error}).') from None
    if not source.strip():
        raise ProgramError('It is empty.')
    if _LAUNCH.search(source) and 'rclpy' not in source:
        raise ProgramError('It is a launch file, which starts programs: hand in the program.')
    try:
        tree = ast.parse(source, str(path))
        compile(tree, str(path), 'exec')
    except SyntaxError as error:
        where = f'line {error.lineno}: ' if error.lineno else ''
        raise ProgramError(f'It does not compile: {where}{error.msg}.') from None
    return tree


def _has_uncalled_main(tree: ast.Module) -> bool:
    """Return whether a program defines main() for `ros2 run`, which calls it."""
    names = [node.id for node in ast.walk(tree) if isinstance(node, ast.Name)]
    return 'main' not in names and any(
        isinstance(node, ast.FunctionDef) and node.name == 'main' for node in tree.body)


def _mere_name(tree: ast.AST) -> str:
    """Return that a statement is a name only, such as `main` in place of `main()`; '': none is."""
    return next((f'line {node.lineno} only names {node.value.id}: a call is {node.value.id}()'
                 for node in ast.walk(tree) if isinstance(node, ast.Expr)
                 and isinstance(node.value, ast.Name)), '')


def _line_with_int(tree: ast.AST) -> int:
    """Return the line of the first assignment such as `translation.x = 0`; 0: there is none."""
    return next((node.lineno for node in ast.walk(tree) if isinstance(node, ast.Assign)
                 and isinstance(node.value, ast.Constant) and type(node.value.value) is int
                 and any(isinstance(target, ast.Attribute) and target.attr in ('x', 'y', 'z', 'w')
                         for target in node.targets)), 0)


def _copy(program: Path, directory: Path) -> None:
    """Copy a program, and what lies beside it, but for what is hidden, large or too much."""
    left = iter(range(_MOST_COPIED))

    def left_out(folder: str, names: list[str]) -> list[str]:
        return [each for each in names if each.startswith('.') or next(left, None) is None
                or os.lstat(os.path.join(folder, each)).st_size > _LONGEST_SOURCE]

    with suppress(OSError):  # of files that cannot be read
        shutil.copytree(program.parent, directory, ignore=left_out)
    shutil.copyfile(program, directory / program.name)


class Program:
    """A student's program, in a copy of its folder and a session of its own."""

    def __init__(self, path: Path, directory: str) -> None:
        """Copy a program and its folder to an empty directory; raise why it is not run."""
        tree = _parsed(path)
        #: Where a number of a message is an int; 0: nowhere.
        self.int_line = _line_with_int(tree)
        self._mere_name = _mere_name(tree)
        self._name, self._original = path.name, Path(os.path.abspath(path.parent))
        self._folder = Path(directory, 'copy', self._original.name)
        _copy(path, self._folder)
        is_module = (self._folder / '__init__.py').is_file() and (
            self._original.name == 'dummy_arm' and path.name == 'dummy_arm.py')
        self._arguments = ['-c', _RUN + (_AS_MODULE if is_module else _AS_FILE) + (
            '["main"]()' * _has_uncalled_main(tree))]
        Path(directory, 'sitecustomize.py').write_text(_ITS_OWN)
        # `pkill -f dummy_arm.py` looks at command lines, but not at the environment.
        self._environment = {
            **os.environ, 'ROS_LOG_DIR': directory,
            'CHECK_ARM_PROGRAM': str(self._folder / self._name), 'PYTHONUNBUFFERED': '1',
            'PYTHONPATH': f'{directory}{os.pathsep}{os.environ.get("PYTHONPATH", directory)}',
            'PYTHONDONTWRITEBYTECODE': '1', 'PYTHONIOENCODING': 'utf-8'}
        self._output = os.open(Path(directory, 'output'), os.O_CREAT | os.O_RDWR | os.O_APPEND)

    def start(self) -> None:
        self._start = time.monotonic()
        self._process = subprocess.Popen(
            [sys.executable, *self._arguments], cwd=self._folder, env=self._environment,
            stdin=subprocess.DEVNULL, stdout=self._output, stderr=self._output,
            start_new_session=True)

    def check(self) -> None:
        """Raise why the program has failed, unless it is running and has printed no traceback."""
        code = self._process.poll()
        size = os.fstat(self._output).st_size
        if size > _LONGEST_OUTPUT:
            raise ProgramError(f'It prints more than {_LONGEST_OUTPUT // 10**6} MB: leave out '
                               'print(), or end its loop.')
        output = os.pread(self._output, _PART, max(0, size - _PART))  # the newest
        if code is None and _TRACEBACK.encode() not in output:
            return
        text = output.decode(errors='replace')
        error = _error_of(text, self._name)
        if copied := re.search(r'import of (\S+) halted(.*)', error):
            raise ProgramError('The arm must be its own: it imports or starts '
                               f'{copied[1]} of this package{copied[2]}.')
        if error:
            is_called = "'NoneType' object is not callable" in error and 'executors.py' in text
            is_input = 'EOFError: EOF when reading a line' in error
            why = _why_not_imported(error, self._folder, self._original)
            raise ProgramError(f'It fails: {error}{_CALLED * is_called}{_INPUT * is_input}{why}')
        if code is not None:
            seconds = time.monotonic() - self._start
            cause = f': {self._mere_name or "does it call rclpy.spin?"}' if code == 0 else ''
            last = text.strip().splitlines()[-1:]
            more = f'; its last line: {abbreviated(visible(last[0]))}' if last else ''
            raise ProgramError(f'It ended by itself after {seconds:.1f} s, {how_it_ended(code)}'
                               f'{cause}{more}{"" if cause or more else "."}')

    def place(self) -> str:
        """Return the line that is running, and its callers; '' if it is spinning, or unknown."""
        begin = os.fstat(self._output).st_size
        self._process.send_signal(signal.SIGUSR1)

        def stack() -> str:
            return os.pread(self._output, _PART, begin).decode(errors='replace')

        # The main thread is the last one, its innermost call is the first, and its outermost calls
        # are in `_RUN`.
        wait_until(_GRACE, lambda: '"<string>"' in stack())
        calls = stack().rpartition('hread 0x')[2].partition('/executors.py"')[0]
        line, *callers = re.findall(rf'/{re.escape(self._name)}", line (\d+)', calls) or ['']
        return f'{line} (called from {comma_list(callers, "line {}".format)})' if callers else line

    def end(self) -> None:
        """End the program by SIGINT, with which it can leave the ROS graph, if it does so soon."""
        with suppress(OSError, subprocess.TimeoutExpired):
            os.killpg(self._process.pid, signal.SIGINT)
            self._process.wait(_GRACE)


def _error_of(output: str, name: str) -> str:
    """Return the error of the first complete traceback, and its line in a file of this name."""
    # The lines of a group of exceptions begin with "  + " or "  | ".
    text = re.sub(r'^ *[+|] ', '', output, flags=re.MULTILINE)
    found = re.search(rf'{re.escape(_TRACEBACK)}\n((?:(?: .*)?\n)*)(\S.*)\n', text)
    if not found:
        return ''
    calls, error = found.groups()
    lines = re.findall(rf'/{re.escape(name)}", line (\d+)', calls)
    where = f' (line {lines[-1]})' if lines else ''
    return f'{abbreviated(visible(error), 300)}{where}'


def _why_not_imported(error: str, folder: Path, original: Path) -> str:
    """
    Say that a module is of ROS 1, or which file of a hand-in hides it; '' if it is not known.

    :param folder: the copy of the folder in which the hand-in is, which is `original`.
    """
    if not error.startswith(('AttributeError: ', 'ImportError: ', 'ModuleNotFoundError: ')):
        return ''
    if re.search(r"No module named '(rospy|roslib|tf)'", error):
        return ': it is of ROS 1; import rclpy, tf2_ros or tf_transformations'
    for name in re.findall(r"'(\w+)[.']", error):
        for file in f'{name}.py', f'{name}/__init__.py':
            if (folder / file).is_file() and name not in ('dummy_arm', '__main__'):
                spec = find_spec(name)
                if spec and not Path(spec.origin or '/').is_relative_to(original):
                    return f': {file} of the hand-in hides the module {name}: rename it'
    return ''
