"""The help of all commands."""

from importlib import import_module
import re

from environment import COMMANDS
import pytest


@pytest.mark.parametrize('command', COMMANDS)
def test_every_command_has_help_with_an_example(capsys, command):
    """`--help` prints the usage and an example, and exits with code 0."""
    with pytest.raises(SystemExit) as end:
        import_module(COMMANDS[command]).main(['--help'])
    assert not end.value.code
    text = capsys.readouterr().out
    assert f'usage: {command} ' in text
    assert re.search(rf'examples?: {command}\b', text)
