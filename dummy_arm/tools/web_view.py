"""The command `web_view`: the frames, live in the browser."""

from collections.abc import Sequence
from pathlib import Path
from time import monotonic
from typing import Optional, TYPE_CHECKING

from dummy_arm.command import Parser, run
from dummy_arm.interruption import sleep
from dummy_arm.tools.bag_options import add_bag_options, read_bag

if TYPE_CHECKING:
    from dummy_arm.view.source import Source

HOST = '127.0.0.1'
_BETWEEN_UPDATES = 1 / 30  # s
_UNSEEN = 0.5  # s, between updates while nobody looks


def command(host: str = HOST, bag: Optional[str] = None, namespace: str = '',
            partial: bool = False, *, ros_args: Sequence[str] = ()) -> int:
    """
    Show the frames in a page, until Ctrl-C.

    :param host: the address at which it is served.
    :param bag: what is played instead of listening; with namespace and partial as
        `dummy_arm.tf.bag.read` has them.
    :returns: the exit code.
    :raises UsageError: when there is no such address.
    :raises CommandError: when no port is free there, or a bag cannot be read.
    """
    if buffer := read_bag(bag, namespace, partial):
        from dummy_arm.view.source import Bag
        _show(Bag(buffer, Path(bag or '').name), host)
    else:
        from dummy_arm.node_command import spun_node
        from dummy_arm.view.live import Live
        with spun_node('web_view', ros_args) as node:
            _show(Live(node), host)
    return 0


def _show(source: 'Source', host: str) -> None:
    from dummy_arm.view.server import served
    from dummy_arm.view.view import View
    with served(host) as server:
        view = View(source, server)
        while True:
            begin = monotonic()
            view.update()
            pause = _BETWEEN_UPDATES if server.get_clients() else _UNSEEN
            sleep(max(0.0, begin + pause - monotonic()))


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command; see `--help`."""
    parser = Parser(
        'web_view', 'Show the frames that are on /tf and /tf_static, or in a bag, in a page for '
        'the browser.',
        'examples: web_view\n          web_view --bag robot.mcap')
    parser.add_argument('--host', default=HOST, metavar='ADDRESS',
                        help='serve the page at this address of the machine; 0.0.0.0: at all that '
                             'it has (default: %(default)s, for this machine only)')
    add_bag_options(parser)
    return run(parser, command, args)
