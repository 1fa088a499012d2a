"""The page: the scene and the panel, updated from a feed and from the viewers' choices."""

from collections.abc import Callable
from time import monotonic
from typing import Optional

import numpy as np
from numpy.typing import NDArray
import viser

from dummy_arm.tf.formatting import SECOND
from dummy_arm.view.details import details, overview
from dummy_arm.view.feed import AnyBuffer, Feed, LENGTH
from dummy_arm.view.panel import Panel
from dummy_arm.view.placement import FrameWatcher, Placement, within_reach
from dummy_arm.view.playback import Playback
from dummy_arm.view.rods import TIMEOUT
from dummy_arm.view.scene import Scene
from dummy_arm.view.viser_private import Server

#: The shortest time between two updates of the texts (s).
_TEXT_PERIOD = 0.2
#: The time between two updates of the hint at other topics (s).
_HINT_PERIOD = 1.0
#: The cameras are moved this long (s) after the first frame has appeared, when most others have.
_SETTLING = 1.0
#: The time between two points of a trail (ns).
_TRAIL_STEP = SECOND // 20
#: If a gap in the trail is longer than this (ns), it is filled with points from the buffer.
_TRAIL_GAP = 4 * _TRAIL_STEP


class Trail:
    """The recent path of a frame; each call of `draw` can add points to it."""

    def __init__(self, buffer: AnyBuffer) -> None:
        self._buffer = buffer
        self._restart('', '')

    def _restart(self, target: str, frame: str) -> None:
        self._frames = target, frame
        self._times = np.empty(0, np.int64)
        self._points = np.empty((0, 3))

    def draw(self, target: str, frame: str, end: int, point: NDArray[np.float64]
             ) -> NDArray[np.float64]:
        """
        Return the lines of the path over the last `LENGTH` seconds, the oldest first.

        :param point: (3,): the position at the time `end` (ns), x, y, z (m).
        :returns: (m, 2, 3): start and end of each line, x, y, z (m), none at unknown times.
        """
        first = max(1, end - LENGTH * SECOND)
        last = max(self._times[-1:].tolist(), default=first)
        # If the last point is later than `end`, time was set back.
        if self._frames != (target, frame) or last > max(end, first):
            self._restart(target, frame)
            last = first
        if end - last > _TRAIL_GAP:
            times = np.arange(max(first, last + 1), end, _TRAIL_STEP, dtype=np.int64)
            points, _, _ = self._buffer.lookup_transforms(target, frame, times)
            self._times = np.append(self._times, times)
            self._points = np.concatenate([self._points, points])
        elif end - last >= _TRAIL_STEP:
            self._times = np.append(self._times, end)
            self._points = np.concatenate([self._points, [point]])
        kept = self._times >= first
        self._times, self._points = self._times[kept], self._points[kept]
        points = np.concatenate([self._points, [point]])
        lines = np.stack([points[:-1], points[1:]], axis=1)
        return lines[np.isfinite(lines).all(axis=(1, 2))]

    def lines(self, placement: Placement, name: str) -> NDArray[np.float64]:
        """Draw the trail of a placed frame in the scene; no lines if the frame has timed out."""
        if name in placement.names:
            i = placement.names.index(name)
            if placement.ages[i] < TIMEOUT:
                anchor, y = placement.anchor_of(name)
                return within_reach(np.array([0.0, y, 0.0]) + self.draw(
                    anchor, name, placement.stamps[i], placement.poses[i, :3]))
        return np.empty((0, 2, 3))


class View:
    """The page."""

    def __init__(self, feed: Feed, server: Server, clock: Callable[[], float] = monotonic
                 ) -> None:
        self._feed, self._player, self._clock = feed, feed.player, clock
        self._watcher = FrameWatcher(feed.buffer, clock)
        self._placement, self._fixed = self._watcher.placement(), ''
        self._scene = Scene(server)
        self._playback = self._player and Playback(server.gui, self._player, feed.findings)
        self._panel = Panel(server.gui, not self._player, self._look_at_all)
        server.on_client_connect(self._look_at_all)
        #: The frames that a viewer can choose.
        self._names: dict[str, None] = {}
        self._trail = Trail(feed.buffer)
        #: The earliest time of the next update of the texts (s, monotonic clock).
        self._next_texts = 0.0
        #: The placement for which the shown texts were made, and three texts: the names of the
        #: chosen fixed frame and of the selected frame, and `_hint`.
        self._texts_key: tuple[Optional[Placement], tuple[str, str, str]] = None, ('', '', '')
        #: The hint at other topics, and the time of its next update (s, monotonic clock).
        self._hint, self._next_hint = '', 0.0
        #: The time at which the cameras of all clients are moved so that all frames are visible
        #: (s, monotonic clock); None until there are frames; infinite after this move.
        self._turn_at: Optional[float] = None
        self._server = server

    def update(self) -> None:
        """Read the feed and the panel, and update the page."""
        panel, now = self._panel, self._clock()
        until = self._playback.update() if self._playback else 0
        fixed = panel.fixed.chosen
        latest = self._watcher.placement(fixed, until)
        if self._player or not panel.is_paused or fixed != self._fixed:
            self._placement, self._fixed = latest, fixed
        placement = self._placement
        # A bag is played again and again, so its frames stay in the dropdowns.
        self._names = dict.fromkeys([*(self._names if self._player else ()), *placement.names])
        panel.set_frames(placement, [*self._names], now)
        if clicked := self._scene.take_click():
            panel.selected.choose(clicked)
        self._scene.show(placement, panel.size, panel.selected.name, panel.with_names,
                         self._trail.lines(placement, panel.trail.name))
        self._update_texts(now, fixed, panel.selected.name)
        self._turn_cameras(now)

    def _update_texts(self, now: float, fixed: str, selected: str) -> None:
        """Update the texts if something has changed, at most once per `_TEXT_PERIOD`."""
        placement, key = self._placement, self._texts_key
        if now >= self._next_hint:
            self._hint, self._next_hint = self._feed.topics_hint(), now + _HINT_PERIOD
        is_new = placement is not key[0] or (fixed, selected, self._hint) != key[1]
        if is_new and now >= self._next_texts:
            self._next_texts = now + _TEXT_PERIOD
            self._texts_key = placement, (fixed, selected, self._hint)
            self._panel.show_texts(overview(placement, self._feed, fixed),
                                   details(placement, selected, self._feed))

    async def _look_at_all(self, client: viser.ClientHandle) -> None:
        """Move the camera of a client so that all frames are visible."""
        self._scene.look_at(self._placement, [client])

    def _turn_cameras(self, now: float) -> None:
        """Move the cameras of all clients once, `_SETTLING` seconds after the first frame."""
        if self._turn_at is None and self._placement.names:
            self._turn_at = now + _SETTLING
        if self._turn_at is not None and now >= self._turn_at:
            self._turn_at = np.inf
            self._scene.look_at(self._placement, self._server.get_clients().values())
