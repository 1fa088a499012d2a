"""The clock of a bag, as the bar at the foot of the page shows it and sets it."""

from argparse import ArgumentTypeError
from contextlib import suppress

from puretf import SECOND
from puretf._text.names import abbreviated
from puretf_tools.cli.times import when
from puretf_tools.inspection.bag_times import both, why_outside
from puretf_tools.view.controls import values
from puretf_tools.view.feed import BagFeed

#: The speeds, from 0.1 to 10 times that of the recording.
_SPEEDS = '0.1', '0.2', '0.5', '1', '2', '5', '10'


class Playback:
    """The bar of a bag; all viewers share it."""

    def __init__(self, feed: BagFeed) -> None:
        self._feed, self._player, self._problem = feed, feed.player, ''
        self.content = ''  #: what the bar shows, for page.js

    def act(self, action: str, what: str) -> None:
        """Do what a viewer requests; whatever else they have sent has no effect."""
        player = self._player
        if action == 'pause':
            player.plays = not player.plays
        elif action == 'step':
            self._step(what == 'back')
        elif action == 'loop':
            player.loops = not player.loops
        elif action == 'speed' and what in _SPEEDS:
            player.speed = float(what)
        elif action == 'seek':
            with suppress(ValueError, OverflowError):  # no number, NaN or infinite
                player.seek(player.begin + round(float(what) * SECOND))
        elif action == 'goto':
            self._problem = self._go_to(abbreviated(what)) if what else ''

    def update(self, is_watched: bool) -> int:
        """Advance the player if somebody looks, and return its time (ns)."""
        player, reading = self._player, self._feed.update()
        player.advance(player.plays and is_watched)
        marks = {(finding.time - player.begin) / SECOND for finding in self._feed.findings
                 if player.begin <= finding.time <= player.end}
        self.content = values('bar', {
            'position': round(player.position, 2), 'length': player.length,
            'time': both(player.time, player.begin), 'plays': player.plays,
            'loops': player.loops, 'speed': f'{player.speed:g}', 'speeds': _SPEEDS,
            'marks': sorted(marks), 'reading': reading, 'problem': self._problem})
        return player.time

    def _step(self, is_back: bool) -> None:
        """Go to the next transform, or back to the last one."""
        time, stamps = self._player.time, []
        for frame in self._feed.buffer.frames():
            if not frame.is_static:
                own = self._feed.buffer.path_stamps(frame.parent, frame.name)
                i = int(own.searchsorted(time, 'left')) - 1 if is_back else int(
                    own.searchsorted(time, 'right'))
                stamps += own[max(i, 0):i + 1].tolist()
        if stamps:
            self._player.stop_at(max(stamps) if is_back else min(stamps))

    def _go_to(self, text: str) -> str:
        """Pause, and go to a time that a viewer has typed; return why that is refused, or ''."""
        span = self._player.begin, self._player.end
        try:
            time = when(text).within(span)
        except ArgumentTypeError as error:
            return str(error)
        if not (why := why_outside(time, span)):
            self._player.stop_at(time or self._player.end)  # 0: the latest
        return why
