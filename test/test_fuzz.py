"""The fuzz targets: their seeds and earlier findings pass, and the runner finds a fault."""

from importlib.util import find_spec
import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
import time

from conftest import code_without, is_running
import pytest

import dummy_arm
from dummy_arm.tf._wire import cdr

pytest.importorskip('bags')
import fuzz
import fuzz_messages

FUZZ = [sys.executable, str(Path(fuzz.__file__))]
needs_atheris = pytest.mark.skipif(  # `make attack` installs it
    find_spec('atheris') is None, reason='atheris, which makes up inputs, is not installed')
needs_viser = pytest.mark.skipif(
    find_spec('viser') is None, reason='viser, which makes the page, is not installed')
needs_ros = pytest.mark.skipif(
    find_spec('rclpy') is None, reason='rclpy, which has the type, is not installed')
MARKS = {'websocket': needs_viser, 'type': needs_ros}
names = pytest.mark.parametrize(
    'name', [pytest.param(name, marks=MARKS.get(name, ())) for name in fuzz.MODULES])
FOUND = [pytest.param(name, path, marks=MARKS.get(name, ()), id=f'{name}/{path.name}')
         for name in fuzz.MODULES for path in fuzz.reproducers(name)]


@pytest.fixture(scope='module', autouse=True)
def _ended():
    """End the processes and servers that targets have started."""
    yield
    fuzz_messages.close()
    if 'fuzz_surfaces' in sys.modules:
        sys.modules['fuzz_surfaces'].close_page()


@pytest.mark.soak
@names
def test_seeds_pass(name):
    """A target finds no fault in its seeds, nor in an empty input."""
    check, seeds = fuzz.target(name)
    count = 0
    for data in seeds():
        check(data)
        count += 1
    assert count >= 5
    check(b'')


@pytest.mark.parametrize(('name', 'path'), FOUND)
def test_what_was_found_passes(name, path):
    """An input that found a fault before finds none any more."""
    fuzz.target(name).check(path.read_bytes())


def test_every_directory_of_findings_has_a_target():
    """No finding is left out because a target was renamed."""
    assert {path.name for path in fuzz.DATA.iterdir()} <= fuzz.MODULES.keys()


def copy_of_the_package(path):
    """Copy the package, the targets and the golden data; names lose a first control character."""
    for name in 'fuzz.py', 'fuzz_messages.py', 'fuzz_surfaces.py', 'bags.py', 'imports.py', 'data':
        source, copied = Path(__file__).parent / name, path / 'test' / name
        if source.is_dir():
            shutil.copytree(source, copied, ignore=lambda *_: ['fuzz'])
        else:
            copied.parent.mkdir(exist_ok=True)
            shutil.copy(source, copied)
    shutil.copytree(Path(dummy_arm.__file__).parent, path / 'dummy_arm')
    decoder = path / 'dummy_arm' / 'tf' / '_wire' / 'cdr.py'
    text = decoder.read_text()
    right = "field.partition(b'\\0')[0].decode"
    assert text.count(right) == 1
    decoder.write_text(text.replace(
        right, "field.partition(b'\\0')[0][b'' < field[:1] < b' ':].decode"))
    return [sys.executable, str(path / 'test' / 'fuzz.py')]


def run(command, *arguments, **variables):
    """Run the fuzzer; return the exit code and the output."""
    done = subprocess.run([*command, *arguments], env={**os.environ, **variables}, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=120)
    return done.returncode, done.stdout


@pytest.mark.attack
@needs_atheris
def test_a_fault_is_found_minimised_and_repeated(tmp_path):
    """A fault that no seed finds is found, and the input finds none in the right package."""
    broken, path = copy_of_the_package(tmp_path), str(tmp_path)
    for data in fuzz.target('cdr').seeds():
        assert not any('\0' < name[:1] < ' ' for row in cdr.unpack(data) for name in row[1:3])
    code, output = run(broken, '5', 'cdr', PYTHONPATH=path)
    assert code == 1, output
    assert re.search(r'^cdr  .* runs .* FAULT, in ', output, re.MULTILINE)
    assert 'AssertionError' in output
    (found,) = (tmp_path / 'test' / 'data' / 'fuzz' / 'cdr').iterdir()
    data = found.read_bytes()
    assert data.count(0) > 0.8 * len(data)
    code, output = run(broken, 'cdr', str(found), PYTHONPATH=path)
    assert (code, 'AssertionError' in output) == (1, True)
    code, output = run(FUZZ, 'cdr', str(found))
    assert (code, 'finds no fault' in output) == (0, True)


def test_an_input_is_minimised_to_what_matters(tmp_path):
    """What is left finds the same fault, not another one; other bytes are zero."""
    def check(data):
        if data[:1] == b'x':
            raise ValueError
        assert b'A' not in data or data.rfind(b'B') < data.find(b'A') + 2

    path = tmp_path / 'input'
    path.write_bytes(bytes(range(32, 127)) * 3)
    fuzz.minimise(check, path)
    assert path.read_bytes() == b'A\0B'


@pytest.mark.attack
@needs_atheris
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_targets(number):
    """Ctrl-C and SIGTERM end the fuzzer and the processes of its targets."""
    process = subprocess.Popen([*FUZZ, '60', 'cdr', 'ros1'], stdout=subprocess.PIPE)
    children = Path(f'/proc/{process.pid}/task/{process.pid}/children')
    deadline = time.monotonic() + 30
    while len(pids := children.read_text().split()) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(number)
    assert process.wait(20) == 128 + number
    assert not any(map(is_running, map(int, pids)))


def test_atheris_is_missing():
    """One line says so and how to install it, with exit code 2."""
    code = code_without(['atheris']) + (
        f'sys.path.insert(0, {str(Path(fuzz.__file__).parent)!r})\n'
        'import fuzz\nsys.exit(fuzz.main(["5"]))')
    exit_code, output = run([sys.executable, '-c', code])
    assert exit_code == 2
    assert re.fullmatch(r"fuzz\.py: No module named 'atheris[^\n]*: pip install [^\n]+\n", output)


@pytest.mark.parametrize('arguments', [[], ['cdr'], ['0'], ['-1'], ['nan'], ['5', 'other']])
def test_wrong_arguments(arguments):
    """One line says what is right, with exit code 2."""
    code, output = run(FUZZ, *arguments)
    assert code == 2
    assert re.fullmatch(r'fuzz\.py: usage: [^\n]+\n', output)
