"""The help of all commands."""

from importlib import import_module
from inspect import getmembers, isfunction
import re

from processes import tool
import pytest

from dummy_arm.cli import entry_points

COMMANDS = [name for name, function in getmembers(entry_points, isfunction)
            if function.__module__ == entry_points.__name__ and name[0] != '_']


@pytest.mark.parametrize('command', COMMANDS)
def test_every_command_has_help_with_an_example(capsys, command):
    """`--help` prints the usage and an example, and exits with code 0."""
    module = 'dummy_arm' if command == 'dummy_arm' else f'tools.{command}'
    with pytest.raises(SystemExit) as end:
        import_module(f'dummy_arm.{module}').main(['--help'])
    assert not end.value.code
    text = capsys.readouterr().out
    assert f'usage: {command} ' in text
    assert re.search(rf'examples?: {command}\b', text)


def test_help_of_a_process(start):
    """The help goes to stdout."""
    process = start(*tool('param', '--help'))
    assert process.exit_code() == 0
    assert process.output.startswith('usage: param ')
