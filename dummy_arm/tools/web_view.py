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
    from dummy_arm.view.source import Source

HOST = '127.0.0.1'
_LAST_PORT = 65535
#: The interval between two updates of the page (s): `_UPDATE_PERIOD` while a browser shows the
#: page, `_IDLE_PERIOD` while no browser shows it.
_UPDATE_PERIOD, _IDLE_PERIOD = 1 / 30, 0.5
#: After an update that took long, since there are many frames, the page rests for this many times
#: as long. Meanwhile viser sends the changes to the viewers.
_REST = 2.0


def command(host: str = HOST, port: Optional[int] = None, bag: Optional[str] = None,
            namespace: str = '', partial: bool = False, *, ros_args: Sequence[str] = ()) -> int:
    """
    Show the frames on a web page, until Ctrl-C.

    :param host: the address at which the page is served.
    :param port: the port of the page; None: 8080, or the next free port if 8080 is in use.
    :param bag: path of the bag to play; None: show /tf and /tf_static.
    :param namespace: the namespace of the topics `tf` and `tf_static`; '': none.
    :param partial: True: if the bag is damaged, read its undamaged parts.
    :param ros_args: the command line, with the name of the command; ROS reads what follows
        `--ros-args`.
    :returns: the exit code.
    :raises UsageError: if `host` is not an address of this machine; see also `read_bag`.
    :raises CommandError: if the bag cannot be read, if the port is in use, if the port needs root
        privileges, or if viser cannot be used.
    """
    if buffer := read_bag(bag, namespace, partial):
        from dummy_arm.view.source import BagSource
        _show(BagSource(buffer, Path(bag or '').name), host, port)
    else:
        from dummy_arm.cli.node import spinning_node
        from dummy_arm.view.source import LiveSource
        with spinning_node('web_view', ros_args, namespace) as node:
            _show(LiveSource(node), host, port)
    return 0


def _show(source: 'Source', host: str, port: Optional[int]) -> None:
    from dummy_arm.view.server import serve
    from dummy_arm.view.view import View
    with serve(host, port) as server:
        view = View(source, server)
        while True:
            start = monotonic()
            view.update()
            spent = monotonic() - start
            pause = _UPDATE_PERIOD if server.get_clients() else _IDLE_PERIOD
            sleep(max(pause - spent, _REST * spent))


def port_number(text: str) -> int:
    """
    Convert a command-line argument to a port.

    :param text: the number of the port.
    :returns: the port.
    :raises argparse.ArgumentTypeError: if the text is not a number from 1 to 65535.
    """
    if not (re.fullmatch('[0-9]{1,5}', text) and 1 <= int(text) <= _LAST_PORT):
        raise ArgumentTypeError(f'a port must be a number from 1 to {_LAST_PORT}, got {text!r}')
    return int(text)


def main(args: Optional[Sequence[str]] = None) -> int:
    """
    Run the command; see `--help`.

    :param args: the command line without the name of the command; None: `sys.argv[1:]`.
    :returns: the exit code.
    """
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
