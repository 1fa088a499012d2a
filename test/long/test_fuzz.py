"""The fuzz targets: their seeds pass, and the runner finds a fault. They take half a minute."""

import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
import time

from environment import ROOT
from processes import is_running
import pytest

from puretf._wire import cdr

pytest.importorskip('bags')
import fuzz
import fuzz_messages

FUZZ = [sys.executable, fuzz.__file__]
#: The modules without which a target cannot be called.
NEEDED = {'websocket': 'viser', 'views': 'viser', 'type': 'rclpy', 'meshes': 'collada',
          'clouds': 'rclpy'}


@pytest.mark.parametrize('name', fuzz.MODULES)
def test_seeds_pass(name):
    """A target finds no fault in its seeds, nor in an empty input."""
    if name in NEEDED:
        pytest.importorskip(NEEDED[name])
    try:
        check, seeds = fuzz.target(name)
        count = 0
        for data in seeds():
            check(data)
            count += 1
        assert count >= 5
        check(b'')
    finally:
        fuzz_messages.close()
        if 'fuzz_surfaces' in sys.modules:
            sys.modules['fuzz_surfaces'].close_page()


def copy_of_the_package(path):
    """Copy the package, the targets and the golden data; names lose a first control character."""
    for name in 'test/support', 'test/data', 'dummy_arm', 'puretf', 'puretf_tools':
        shutil.copytree(ROOT / name, path / name, ignore=shutil.ignore_patterns(
            'fuzz', '__pycache__'))
    decoder = path / 'puretf' / '_wire' / 'cdr.py'
    text = decoder.read_text()
    right = "field.partition(b'\\0')[0].decode"
    assert text.count(right) == 1
    decoder.write_text(text.replace(
        right, "field.partition(b'\\0')[0][b'' < field[:1] < b' ':].decode"))
    return [sys.executable, str(path / 'test' / 'support' / 'fuzz.py')]


def run(command, *arguments, **variables):
    """Run the fuzzer; return the exit code and the output."""
    done = subprocess.run([*command, *arguments], env={**os.environ, **variables}, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    return done.returncode, done.stdout


def test_a_fault_is_found_minimised_and_repeated(tmp_path):
    """A fault that no seed finds is found, and the input finds none in the right package."""
    pytest.importorskip('atheris')
    broken, path = copy_of_the_package(tmp_path), str(tmp_path)
    for data in fuzz.target('cdr').seeds():
        assert not any('\0' < name[:1] < ' ' for row in cdr.unpack(data) for name in row[1:3])
    code, output = run(broken, '15', 'cdr', PYTHONPATH=path)
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


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_targets(number):
    """Ctrl-C and SIGTERM end the fuzzer and the processes of its targets."""
    pytest.importorskip('atheris')
    with subprocess.Popen([*FUZZ, '600', 'cdr', 'ros1'], stdout=subprocess.PIPE) as process:
        children = Path(f'/proc/{process.pid}/task/{process.pid}/children')
        while len(pids := children.read_text().split()) < 2:
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(number)
        assert process.wait() == 128 + number
    assert not any(map(is_running, map(int, pids)))
