"""The fuzz targets: their seeds pass, and the runner finds a fault. They take half a minute."""

import os
import shutil
import subprocess
import sys

from environment import ROOT
import pytest

from puretf._wire.encoding import CDR

pytest.importorskip('bags')
import fuzz
import fuzz_messages

FUZZ = [sys.executable, fuzz.__file__]
#: The modules without which a target cannot be called.
NEEDED = {'websocket': 'viser', 'views': 'viser', 'meshes': 'collada', 'clouds': 'rclpy'}


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
    decoder = path / 'puretf' / '_wire' / 'encoding.py'
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


def test_a_fault_is_found_and_repeated(tmp_path):
    """A fault that no seed finds is found, and the input finds none in the right package."""
    pytest.importorskip('atheris')
    broken, path = copy_of_the_package(tmp_path), str(tmp_path)
    for data in fuzz.target('cdr').seeds():
        assert not any('\0' < name[:1] < ' ' for row in CDR.unpack(data) for name in row[1:3])
    code, output = run(broken, 'cdr', str(tmp_path / 'corpus'), '-max_total_time=60',
                       PYTHONPATH=path)
    assert code != 0, output
    assert 'AssertionError' in output
    (found,) = (tmp_path / 'test' / 'data' / 'fuzz' / 'cdr').iterdir()
    code, output = run(broken, 'cdr', str(found), PYTHONPATH=path)
    assert code != 0
    assert 'AssertionError' in output
    code, output = run(FUZZ, 'cdr', str(found))
    assert (code, 'AssertionError' in output) == (0, False)
