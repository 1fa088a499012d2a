"""The command `web_view`: show the frames, live or from a bag, in the browser."""

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
    from dummy_arm.view.feed import Feed

HOST = '127.0.0.1'
_LAST_PORT = 65535
#: The interval between two updates of the page (s): `_UPDATE_PERIOD` while a browser shows the
#: page, `_IDLE_PERIOD` while no browser shows it.
_UPDATE_PERIOD, _IDLE_PERIOD = 1 / 30, 0.5
#: After an update that took long, since there are many frames, the page rests for this many times
#: as long. Meanwhile viser sends the changes to the viewers.
_REST = 2.0


def command(host: str = HOST, port: Optional[int] = None, bag: Optional[Sequence[str]] = None,
            namespace: str = '', partial: bool = False, *, ros_args: Sequence[str] = ()) -> int:
    """Show the frames on a web page, until Ctrl-C."""
    if buffer := read_bag(bag, namespace, partial):
        from dummy_arm.view.feed import BagFeed
        _show(BagFeed(buffer, Path(bag[0] if bag else '').name), host, port)
    else:
        from dummy_arm.cli.node import spinning_node
        from dummy_arm.view.feed import LiveFeed
        with spinning_node('web_view', ros_args, namespace) as node:
            _show(LiveFeed(node), host, port)
    return 0


def _show(feed: 'Feed', host: str, port: Optional[int]) -> None:
    from dummy_arm.view.server import serve
    from dummy_arm.view.view import View
    with serve(host, port) as server:
        view = View(feed, server)
        while True:
            start = monotonic()
            view.update()
            spent = monotonic() - start
            pause = _UPDATE_PERIOD if server.get_clients() else _IDLE_PERIOD
            sleep(max(pause - spent, _REST * spent))


def port_number(text: str) -> int:
    """Convert a command-line argument to a port."""
    if not (re.fullmatch('[0-9]{1,5}', text) and 1 <= int(text) <= _LAST_PORT):
        raise ArgumentTypeError(f'a port must be a number from 1 to {_LAST_PORT}, got {text!r}')
    return int(text)


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command; see `--help`."""
    parser = Parser(
        'web_view', 'Show the frames of /tf and /tf_static, or of a bag, on a page in the '
        'browser.',
        'examples: web_view\n          web_view --port 8090\n          web_view --bag robot.mcap')
    parser.add_argument('--host', default=HOST, metavar='ADDRESS',
                        help='serve the page at this address of the machine; 0.0.0.0: at all its '
                             'addresses (default: %(default)s, for this machine only)')
    parser.add_argument('--port', type=port_number, metavar='N',
                        help='serve the page at this port, from 1 to 65535 (default: 8080, or the '
                             'next free one)')
    add_bag_options(parser)
    return run(parser, command, args)
