"""The examples in docstrings: `>>>` and the output of Python."""

import doctest
from importlib import import_module

from imports import modules
import pytest

from dummy_arm.tf import formatting

NAMES = [name for name, path in modules().items() if '>>> ' in path.read_text()]


@pytest.mark.parametrize('name', NAMES)
def test_examples_are_right(name):
    """Each example prints what its docstring says."""
    failed, attempted = doctest.testmod(import_module(name))
    assert attempted > 0
    assert failed == 0


@pytest.mark.parametrize('name', [
    name for name in formatting.__all__ if callable(getattr(formatting, name))])
def test_every_function_for_texts_has_an_example(name):
    """An example shows the format at a glance."""
    assert '>>> ' in (getattr(formatting, name).__doc__ or '')
