"""The pace of a viewer, who gets an update when the one before was handled; and their storage."""

from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from threading import Thread
from typing import Optional

import viser

#: How long a viewer waits for what the browser has stored (s).
_PATIENCE = 5.0


class Pace:
    """
    Waits for a viewer, so that updates do not queue on a slow link or in a slow browser.

    A browser handles all messages in their order. So when it answers a question about its storage,
    it has handled the update that was sent before.
    """

    def __init__(self, client: viser.ClientHandle, key: str) -> None:
        """Read what the browser has stored under a key; meanwhile, the viewer is waited for."""
        self._client, self._key = client, key
        self._moves: SimpleQueue[Optional[Callable[[], object]]] = SimpleQueue()
        self.stored: Optional[str] = None
        self.is_blocked = False  #: True if the browser stores nothing
        self.is_waiting = True  #: True until the last update has been handled
        Thread(target=self._work, daemon=True).start()

    def when_handled(self, move: Callable[[], object]) -> None:
        """Call a function in another thread, as soon as what was sent before has been handled."""
        self.is_waiting = True
        self._moves.put(move)

    def close(self) -> None:
        """End the thread."""
        self._moves.put(None)

    def store(self, text: str) -> None:
        """Let the browser store a text, in place of the one before."""
        if text != self.stored:
            self.stored = text
            self._client.local_storage.set_item(self._key, text)

    def _work(self) -> None:
        try:
            self.stored = self._client.local_storage.get_item(self._key, _PATIENCE)
        except RuntimeError:  # or the viewer has left
            self.is_blocked = True
        except TimeoutError:
            pass
        self.is_waiting = False
        while move := self._moves.get():
            with suppress(RuntimeError):  # the storage is blocked, or the viewer has left
                self._client.local_storage.get_item('handled')
            move()
            self.is_waiting = False
