"""The pace of a viewer: it is sent an update when it has handled the one before."""

from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from threading import Thread
from typing import Optional

import viser


class Pace:
    """
    Waits for a viewer, so that updates do not queue on a slow link or in a slow browser.

    A browser handles all messages in their order. So when it answers a question about its storage,
    it has handled the update that was sent before.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._moves: SimpleQueue[Optional[Callable[[], object]]] = SimpleQueue()
        self.is_waiting = False  #: True until the last update has been handled
        Thread(target=self._work, daemon=True).start()

    def when_handled(self, move: Callable[[], object]) -> None:
        """Call a function in another thread, as soon as what was sent before has been handled."""
        self.is_waiting = True
        self._moves.put(move)

    def close(self) -> None:
        """End the thread."""
        self._moves.put(None)

    def _work(self) -> None:
        while move := self._moves.get():
            with suppress(RuntimeError):  # the storage is blocked, or the viewer has left
                self._client.local_storage.get_item('handled')
            move()
            self.is_waiting = False
