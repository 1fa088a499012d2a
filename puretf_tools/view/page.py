"""Serve the page until a signal ends the command."""

from collections.abc import Sequence
from threading import Thread
from time import monotonic
from typing import Optional

from puretf_tools.cli.signals import sleep
from puretf_tools.view.feed import Feed
from puretf_tools.view.server import serve
from puretf_tools.view.view import View

#: The interval between two updates of the page (s): `_UPDATE_PERIOD` while a browser shows the
#: page, `_IDLE_PERIOD` while no browser shows it.
_UPDATE_PERIOD, _IDLE_PERIOD = 1 / 30, 0.5
#: After an update that took long, since there are many frames, the page rests for this many times
#: as long. Meanwhile viser sends the changes to the viewers.
_REST = 2.0


def show(feed: Feed, host: str, port: Optional[int], meshes: Sequence[str] = (),
         examination: Optional[Thread] = None) -> None:
    """Serve the page of a feed; start a thread when the page is there."""
    with serve(host, port) as server:
        view = View(feed, server, meshes=meshes)
        if examination:
            examination.start()
        while True:
            start = monotonic()
            view.update()
            spent = monotonic() - start
            pause = _UPDATE_PERIOD if server.get_clients() else _IDLE_PERIOD
            sleep(max(pause - spent, _REST * spent))
