"""The examples in docstrings: `>>>` and the output of Python."""

import doctest
from importlib import import_module

from imports import modules
import pytest

NAMES = [name for name, path in modules().items() if '>>> ' in path.read_text()]


@pytest.mark.parametrize('name', NAMES)
def test_examples_are_right(name):
    """Each example prints what its docstring says."""
    failed, attempted = doctest.testmod(import_module(name))
    assert attempted > 0
    assert failed == 0
