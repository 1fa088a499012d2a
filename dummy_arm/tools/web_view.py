"""The command `web_view`: the frames, live in the browser."""

from argparse import ArgumentTypeError
from collections.abc import Sequence
from pathlib import Path
import re
from time import monotonic
from typing import Optional, TYPE_CHECKING

from dummy_arm.cli.bag_options import add_bag_options, read_bag
from dummy_arm.cli.parser import Parser, run
from dummy_arm.cli.signals import sleep

if TYPE_CHECKING:
    from dummy_arm.view.source import Source

HOST = '127.0.0.1'
_BETWEEN_UPDATES = 1 / 30  # s
_LAST_PORT = 65535
_UNSEEN = 0.5  # s, between updates while nobody looks


def command(host: str = HOST, port: Optional[int] = None, bag: Optional[str] = None,
            namespace: str = '', partial: bool = False, *, ros_args: Sequence[str] = ()) -> int:
    """
    Show the frames in a page, until Ctrl-C.

    :param host: the address at which it is served.
    :param port: the port there; None: 8080, or the next that is free.
    :param bag: what is played instead of listening; with namespace and partial as
        `dummy_arm.tf.bag.read` has them.
    :returns: the exit code.
    :raises UsageError: when there is no such address.
    :raises CommandError: when the port is taken or needs root, or a bag cannot be read.
    """
    if buffer := read_bag(bag, namespace, partial):
        from dummy_arm.view.source import BagSource
        _show(BagSource(buffer, Path(bag or '').name), host, port)
    else:
        from dummy_arm.cli.node import spinning_node
        from dummy_arm.view.source import LiveSource
        with spinning_node('web_view', ros_args) as node:
            _show(LiveSource(node), host, port)
    return 0


def _show(source: 'Source', host: str, port: Optional[int]) -> None:
    from dummy_arm.view.server import serve
    from dummy_arm.view.view import View
    with serve(host, port) as server:
        view = View(source, server)
        while True:
            begin = monotonic()
            view.update()
            pause = _BETWEEN_UPDATES if server.get_clients() else _UNSEEN
            sleep(max(0.0, begin + pause - monotonic()))


def port_number(text: str) -> int:
    """
    Read a port of an argument.

    :raises argparse.ArgumentTypeError: when it is not one.
    """
    if not (re.fullmatch('[0-9]{1,5}', text) and 1 <= int(text) <= _LAST_PORT):
        raise ArgumentTypeError(f'{text!r} is no port: that is a number from 1 to {_LAST_PORT}')
    return int(text)


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command; see `--help`."""
    parser = Parser(
        'web_view', 'Show the frames that are on /tf and /tf_static, or in a bag, in a page for '
        'the browser.',
        'examples: web_view\n          web_view --port 8090\n          web_view --bag robot.mcap')
    parser.add_argument('--host', default=HOST, metavar='ADDRESS',
                        help='serve the page at this address of the machine; 0.0.0.0: at all that '
                             'it has (default: %(default)s, for this machine only)')
    parser.add_argument('--port', type=port_number, metavar='N',
                        help='serve it at this port, from 1 to 65535 (default: 8080, or the next '
                             'that is free)')
    add_bag_options(parser)
    return run(parser, command, args)
