"""How late this program runs, as on a busy computer."""

from collections import deque
from threading import Event, Thread
from time import monotonic_ns, time_ns

from puretf import SECOND

#: The time between two beats (s), and by how much they are late on any computer (ns).
_PERIOD, _USUAL = 0.05, SECOND // 200
#: The largest number of late beats that are kept.
_MOST = 10_000


class Pulse(Thread):
    """A thread that notes when it wakes up late."""

    def __init__(self) -> None:
        super().__init__(name='pulse', daemon=True)
        self._late, self._end = deque[tuple[int, int]](maxlen=_MOST), Event()
        self.start()

    def run(self) -> None:
        last = monotonic_ns()
        while not self._end.wait(_PERIOD):
            now = monotonic_ns()
            if (late := now - last - round(_PERIOD * SECOND)) > _USUAL:
                self._late.append((time_ns(), late))
            last = now

    def late(self, seconds: float) -> list[tuple[int, int]]:
        """Return when it was late within some time (ns, system clock), and by how much (ns)."""
        begin = time_ns() - seconds * SECOND
        return [each for each in tuple(self._late) if each[0] > begin]

    def end(self) -> None:
        self._end.set()
