"""The examples in docstrings: `>>>` and the output of Python."""

import doctest
from importlib import import_module

from imports import modules
import pytest

import puretf

NAMES = [name for name, path in modules().items() if '>>> ' in path.read_text()]


@pytest.mark.parametrize('name', NAMES)
def test_examples_are_right(name):
    """Each example prints what its docstring says."""
    failed, attempted = doctest.testmod(import_module(name))
    assert attempted > 0
    assert failed == 0


def test_every_function_for_texts_has_an_example():
    """An example shows the format at a glance."""
    functions = [each for name, module in puretf._MODULES.items()
                 if module in ('_text.names', '_text.similar_names', '_text.times')
                 and callable(each := getattr(puretf, name))]
    assert functions
    assert not [each for each in functions if '>>> ' not in each.__doc__]
