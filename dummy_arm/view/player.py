"""The time of a bag that is played."""

from collections.abc import Iterable
from time import monotonic

from dummy_arm.tf.frames import Frame
from dummy_arm.tf.times import SECOND

#: A stamp that is farther from most others is not of the same recording (ns).
_FAR = 24 * 3600 * SECOND


class Player:
    """Goes through the time of a bag, as fast as it was recorded, to its end."""

    def __init__(self, frames: Iterable[Frame]) -> None:
        """
        Stand at the begin.

        :param frames: what the bag has.
        """
        moving = [frame for frame in frames if not frame.is_static and frame.oldest > 0]
        self._begin = min(_without_strays([frame.oldest for frame in moving]))
        self._end = max(self._begin, *_without_strays([frame.latest for frame in moving]))
        self._position, self._last = 0, monotonic()

    @property
    def length(self) -> float:
        """How long the bag is (s); 0 where nothing moves."""
        return (self._end - self._begin) / SECOND

    @property
    def position(self) -> float:
        """How long after the begin it is (s)."""
        return self._position / SECOND

    @property
    def time(self) -> int:
        """What time it is (ns)."""
        return self._begin + self._position

    @property
    def is_at_end(self) -> bool:
        """Whether there is nothing more."""
        return self.time >= self._end

    def go(self, plays: bool) -> None:
        """
        Go on, by the time since the last call.

        :param plays: whether it goes on at all; at the end it begins anew.
        """
        now = monotonic()
        passed, self._last = now - self._last, now
        if plays:
            self._position = min(self._end - self._begin, 0 if self.is_at_end else
                                 self._position + round(passed * SECOND))

    def seek(self, position: float) -> None:
        """Go to a time after the begin (s)."""
        self._position = min(max(0, round(position * SECOND)), self._end - self._begin)


def _without_strays(stamps: list[int]) -> list[int]:
    """Leave out the stamps that are far from the middle one, as those before the clock was set."""
    if not stamps:
        return [1]
    middle = sorted(stamps)[len(stamps) // 2]
    return [stamp for stamp in stamps if abs(stamp - middle) < _FAR]
