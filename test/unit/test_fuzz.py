"""The program that fuzzes the package by night, and the inputs with which it has found faults."""

from importlib.util import find_spec
import sys

import pytest

pytest.importorskip('bags')
import fuzz
import fuzz_messages

#: The modules without which a target cannot be called.
NEEDED = {'websocket': 'viser', 'views': 'viser', 'meshes': 'collada', 'clouds': 'rclpy'}
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
