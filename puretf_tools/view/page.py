"""Serve the page until a signal ends the command."""

from collections.abc import Callable, Sequence
from time import monotonic
from typing import Optional

from puretf_tools.cli.signals import sleep, wait_until
from puretf_tools.view.feed import Feed
from puretf_tools.view.server import serve
from puretf_tools.view.view import View

#: The interval between two updates of the page (s): `_UPDATE_PERIOD` while a browser shows the
#: page, `_IDLE_PERIOD` while no browser shows it.
_UPDATE_PERIOD, _IDLE_PERIOD = 1 / 30, 0.5
#: After an update that took long, since there are many frames, the page rests for this many times
#: as long. Meanwhile viser sends the changes to the viewers.
_REST = 4.0


def show(feed: Feed, host: str, port: Optional[int], meshes: Sequence[str] = (),
         on_served: Callable[[], object] = lambda: None) -> None:
    """Serve the page of a feed; call a function when the page is there."""
    with serve(host, port) as server:
        view = View(feed, server, meshes=meshes)
        on_served()
        while True:
            start = monotonic()
            view.update()
            spent = monotonic() - start
            sleep(max(_UPDATE_PERIOD - spent, _REST * spent))
            wait_until(_IDLE_PERIOD, server.get_clients)
