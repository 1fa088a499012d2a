"""The program that fuzzes the package by night, and the inputs with which it has found faults."""

from importlib.util import find_spec
import re
import sys

import pytest

pytest.importorskip('bags')
import fuzz
import fuzz_messages

#: The modules without which a target cannot be called.
NEEDED = {'websocket': 'viser', 'views': 'viser', 'type': 'rclpy', 'meshes': 'collada',
          'clouds': 'rclpy'}
FOUND = [(name, path) for name in fuzz.MODULES for path in fuzz.reproducers(name)]


@pytest.mark.parametrize(('name', 'path'), FOUND, ids=lambda value: getattr(value, 'name', value))
def test_what_was_found_passes(name, path):
    """An input that found a fault before finds none any more."""
    if name in NEEDED and find_spec(NEEDED[name]) is None:
        pytest.skip(f'{NEEDED[name]} is not installed')
    try:
        fuzz.target(name).check(path.read_bytes())
    finally:
        fuzz_messages.close()
        if 'fuzz_surfaces' in sys.modules:
            sys.modules['fuzz_surfaces'].close_page()


def test_every_directory_of_findings_has_a_target():
    """No finding is left out because a target was renamed."""
    assert {path.name for path in fuzz.DATA.iterdir()} <= fuzz.MODULES.keys()


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


def test_atheris_is_missing(failed, monkeypatch):
    """One line says so and how to install it, with exit code 2."""
    monkeypatch.setitem(sys.modules, 'atheris', None)
    code, error = failed(fuzz.main, '5')
    assert code == 2
    assert re.fullmatch(r'fuzz\.py: import of atheris [^\n]*: pip install [^\n]+\n', error)


@pytest.mark.parametrize('arguments', [[], ['cdr'], ['0'], ['-1'], ['nan'], ['5', 'other']])
def test_wrong_arguments(failed, arguments):
    """One line says what is right, with exit code 2."""
    code, error = failed(fuzz.main, *arguments)
    assert code == 2
    assert re.fullmatch(r'fuzz\.py: usage: [^\n]+\n', error)
