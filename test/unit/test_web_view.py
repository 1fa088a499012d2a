"""The command web_view where there is no ROS: its address, its port, what it needs."""

import errno
import socket
import subprocess
import sys

from processes import tool_without
import pytest

from puretf_tools.commands.web_view import main


@pytest.fixture
def bag(bags, tmp_path):
    """The path of a short bag."""
    pytest.importorskip('viser')
    return str(bags.make(tmp_path / 'bag', 'mcap', bags.walk(1)))


def test_an_address_that_is_none(failed, bag):
    """It is refused in one line that says what is accepted."""
    for host in '', '..', '192.0.2.1':
        code, error = failed(main, '--bag', bag, '--host', host)
        assert code == 2
        assert len(error.splitlines()) == 1
        assert '--host takes' in error


def test_a_port_that_is_taken(failed, bag):
    """It is an error, and no other port is used instead."""
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        assert failed(main, '--bag', bag, '--port', str(port)) == (
            1, f'web_view: port {port} of 127.0.0.1 is in use: end the program that uses it, '
            'choose another port, or leave out --port to take the next free one\n')


def test_a_port_that_needs_root(failed, monkeypatch, bag):
    """The error blames the port, not the address."""
    def refuse(*_):
        raise PermissionError(errno.EACCES, 'refused')

    monkeypatch.setattr(socket.socket, 'bind', refuse)
    code, error = failed(main, '--bag', bag, '--port', '80')
    assert code == 1
    assert error == ('web_view: cannot serve at port 80 of 127.0.0.1: Permission denied; '
                     'without root, --port must be at least 1024\n')


@pytest.mark.parametrize('text', ['nonsense', '{"Grid": 1}', None])
def test_a_view_that_cannot_be_read(failed, bag, tmp_path, text):
    """The error names the file, and where such a line comes from."""
    path = tmp_path / 'view.json'
    if text is not None:
        path.write_text(text)
    code, error = failed(main, '--bag', bag, '--view', str(path))
    assert code == 1
    assert error.startswith(f'web_view: cannot read {path}: No such file' if text is None else (
        f'web_view: {path}: Grid cannot be 1: copy the line that' if 'Grid' in text else
        f'web_view: {path}: this is no view: copy the line that "copy view" shows'))


@pytest.mark.parametrize('options', [[], ['--export', 'page.html']])
def test_without_viser(bag, there, options):
    """The error says what is missing, and how to install it."""
    done = subprocess.run(
        [sys.executable, *tool_without(['viser'], 'web_view', '--bag', bag, *options)],
        capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == ('web_view: viser, which makes the page, cannot be imported (No '
                           "module named 'viser'): pip install 'viser>=1.1.1,<1.2'\n")
