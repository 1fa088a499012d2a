"""Time that goes back: the stamps of a publisher, such as those of a bag played in a loop."""

from collections import defaultdict
from collections.abc import Callable
from time import monotonic
from typing import NamedTuple, TYPE_CHECKING

from puretf import Frame, in_seconds, SECOND
from puretf._text.names import comma_list, visible

if TYPE_CHECKING:
    from puretf.publisher_listener import PublisherListener

#: Stamps that are older than the newest one by less than this (ns) are only late.
_SMALLEST = SECOND
#: Time has gone back if transforms have arrived for this time (s), and none has a newer stamp.
_PATIENCE = 1.0
#: A frame is silent if nothing has arrived for this time (s).
_SILENT = 3.0
#: For this time (s), `follow` says what it has done.
_REPORTED = 10.0


class _Seen(NamedTuple):
    latest: int  #: the newest stamp (ns)
    latest_at: float  #: when it was first seen (s)
    arrived: int  #: the stamp of the transform that arrived last (ns)
    arrived_at: float

    @property
    def distance(self) -> float:
        """By how much the stamps have gone back (s)."""
        return in_seconds(self.latest - self.arrived) + self.arrived_at - self.latest_at


class TimeWatch:
    """Watches the stamps of a listener, and clears its buffer if those of a publisher go back."""

    def __init__(self, listener: 'PublisherListener', clock: Callable[[], float] = monotonic
                 ) -> None:
        self._listener, self._clock = listener, clock
        self._seen: dict[str, _Seen] = {}  # by dynamic frame
        self._report, self._report_end = '', 0.0

    def follow(self) -> str:
        """
        Clear the buffer if all transforms of a publisher have gone back in time, as in rviz2.

        If newer transforms are from another publisher that still exists, the buffer stays as it
        is, since it would have to be cleared again and again. To be called once a second.

        :returns: who has gone back, and by how much; '' if nobody has within the last 10 s.
        """
        now, before, self._seen = self._clock(), self._seen, {}
        back: defaultdict[str, list[Frame]] = defaultdict(list)  # by publisher
        forward: set[str] = set()
        for frame in self._listener.buffer.frames():
            if frame.is_static:
                continue
            is_behind = frame.latest - frame.arrived > _SMALLEST
            seen = _Seen(frame.latest, now, frame.arrived, now)
            if old := before.get(frame.name):
                if old.latest == frame.latest:
                    seen = seen._replace(latest_at=old.latest_at)
                if old.arrived == frame.arrived:
                    seen = seen._replace(arrived_at=old.arrived_at)
            self._seen[frame.name] = seen
            if now - seen.arrived_at >= _SILENT:
                continue
            if is_behind and now - seen.latest_at >= _PATIENCE:
                back[frame.sender].append(frame)
            else:
                forward.add(frame.sender)
        reports = [self._text(sender, frames) for sender, frames in back.items()]
        if reports:
            if any(sender not in forward and not self._others(sender, frames)
                   for sender, frames in back.items()):
                self._listener.buffer.clear()
                self._seen = {}
            self._report, self._report_end = '; '.join(reports), now + _REPORTED
        return self._report if now < self._report_end else ''

    def _others(self, sender: str, frames: list[Frame]) -> set[str]:
        """Return the publishers that have sent newer transforms of these frames, and exist."""
        return {frame.authority for frame in frames if frame.authority != sender
                and self._listener.is_present(frame.authority) is not False}

    def _text(self, sender: str, frames: list[Frame]) -> str:
        names = self._listener.names_of({sender, *(frame.authority for frame in frames)})
        distance = max(self._seen[frame.name].distance for frame in frames)
        text = (f'transforms arrive from {visible(names[sender])}, but their time went back by '
                f'{distance:.{0 if distance >= 10.0 else 1}f} s')
        if others := self._others(sender, frames):
            newer = comma_list(sorted({names[other] for other in others}), visible)
            text += f' (newer ones are from {newer})'
        return text
