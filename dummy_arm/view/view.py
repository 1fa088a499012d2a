"""The page: the scene and the panel, updated from a source and from the viewers' choices."""

from collections.abc import Callable
from time import monotonic
from typing import Optional

import numpy as np
from numpy.typing import NDArray
import viser

from dummy_arm.tf.formatting import SECOND
from dummy_arm.view.details import details, overview
from dummy_arm.view.panel import Panel
from dummy_arm.view.rods import TIMEOUT
from dummy_arm.view.scene import Scene
from dummy_arm.view.server import Server
from dummy_arm.view.snapshot import FrameWatcher, Snapshot, within_reach
from dummy_arm.view.source import AnyBuffer, LENGTH, Source

#: The shortest time between two updates of the texts (s).
_TEXT_PERIOD = 0.2
#: The time between two updates of the hint at other topics (s).
_HINT_PERIOD = 1.0
#: The cameras are moved this long (s) after the first frame has appeared. In this time, most other
#: frames appear.
_SETTLING = 1.0
#: The time between two points of a trail (ns).
_TRAIL_STEP = SECOND // 20
#: If a gap in the trail is longer than this (ns), it is filled with points from the buffer.
_TRAIL_GAP = 4 * _TRAIL_STEP


class Trail:
    """The recent path of a frame; each call of `draw` can add points to it."""

    def __init__(self, buffer: AnyBuffer) -> None:
        """
        Create a trail without points.

        :param buffer: the buffer from which gaps in the trail are filled.
        """
        self._buffer = buffer
        self._restart('', '')

    def _restart(self, target: str, frame: str) -> None:
        self._frames = target, frame
        self._times = np.empty(0, np.int64)
        self._points = np.empty((0, 3))

    def draw(self, target: str, frame: str, end: int, point: NDArray[np.float64]
             ) -> NDArray[np.float64]:
        """
        Compute the path of a frame over the last `LENGTH` seconds.

        :param target: the frame in which the path is expressed.
        :param frame: the frame whose path is computed.
        :param end: the time of the last point (ns).
        :param point: (3,): the position of the frame in `target` at the time `end`, x, y, z (m).
        :returns: (m, 2, 3): the start and the end of each line, x, y, z (m), the oldest line
            first. A line is left out if its start or its end is at a time without a transform.
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


class View:
    """The page that shows a source: the scene and the panel."""

    def __init__(self, source: Source, server: Server, clock: Callable[[], float] = monotonic
                 ) -> None:
        """
        Create the page; `update` fills it.

        :param source: the source of the frames.
        :param server: the server of the page.
        :param clock: a function that returns the time (s), which never goes back.
        """
        self._source, self._player, self._clock = source, source.player, clock
        self._watcher = FrameWatcher(source.buffer, clock)
        self._snapshot, self._fixed = self._watcher.snapshot(), ''
        self._scene = Scene(server)
        self._panel = Panel(server.gui, self._player.length if self._player else 0.0,
                            self._look_at_all)
        server.on_client_connect(self._look_at_all)
        #: The frames that a viewer can choose.
        self._names: dict[str, None] = {}
        self._trail = Trail(source.buffer)
        #: The snapshot and the frame for which `_lines`, the lines of the trail, were computed.
        self._trail_key: tuple[Optional[Snapshot], str] = None, ''
        self._lines = np.empty((0, 2, 3))
        #: The earliest time of the next update of the texts (s, monotonic clock).
        self._next_texts = 0.0
        #: The snapshot for which the shown texts were made, and three texts: the names of the
        #: chosen fixed frame and of the selected frame, and `_hint`.
        self._texts_key: tuple[Optional[Snapshot], tuple[str, str, str]] = None, ('', '', '')
        #: The hint at other topics, and the time of its next update (s, monotonic clock).
        self._hint, self._next_hint = '', 0.0
        #: The time at which the cameras of all clients are moved so that all frames are visible
        #: (s, monotonic clock); None until there are frames; infinite after this move.
        self._turn_at: Optional[float] = None
        self._server = server

    def update(self) -> None:
        """Read the source and the panel, and update the page."""
        panel, now = self._panel, self._clock()
        until = self._advance() if self._player else 0
        fixed = panel.fixed.chosen
        latest = self._watcher.snapshot(fixed, until)
        if self._player or not panel.is_paused or fixed != self._fixed:
            self._snapshot, self._fixed = latest, fixed
        snapshot = self._snapshot
        # A bag is played again and again, so its frames stay in the dropdowns.
        self._names = dict.fromkeys([*(self._names if self._player else ()), *snapshot.names])
        panel.set_frames(snapshot, [*self._names], now)
        if clicked := self._scene.take_click():
            panel.selected.choose(clicked)
        self._draw_trail(panel.trail.name)
        self._scene.show(snapshot, panel.size, panel.selected.name, panel.with_names, self._lines)
        self._update_texts(now, fixed, panel.selected.name)
        self._turn_cameras(now)

    def _advance(self) -> int:
        """Advance the player of a bag, and return the time of the player (ns)."""
        player, requested = self._player, self._panel.take_requested_time()
        assert player is not None
        player.advance(not self._panel.is_paused)
        if requested is not None:
            player.seek(requested)
        self._panel.show_time(player.position)
        return player.time

    def _draw_trail(self, name: str) -> None:
        """Update the lines of the trail if the snapshot or the frame has changed."""
        snapshot = self._snapshot
        if snapshot is self._trail_key[0] and name == self._trail_key[1]:
            return
        self._trail_key, self._lines = (snapshot, name), np.empty((0, 2, 3))
        if name in snapshot.names:
            i = snapshot.names.index(name)
            anchor, y = snapshot.anchor_of(name)
            if snapshot.ages[i] < TIMEOUT:
                self._lines = within_reach(np.array([0.0, y, 0.0]) + self._trail.draw(
                    anchor, name, snapshot.stamps[i], snapshot.poses[i, :3]))

    def _update_texts(self, now: float, fixed: str, selected: str) -> None:
        """Update the texts if something has changed, at most once per `_TEXT_PERIOD`."""
        snapshot, key = self._snapshot, self._texts_key
        if now >= self._next_hint:
            self._hint, self._next_hint = self._source.topics_hint(), now + _HINT_PERIOD
        is_new = snapshot is not key[0] or (fixed, selected, self._hint) != key[1]
        if is_new and now >= self._next_texts:
            self._next_texts = now + _TEXT_PERIOD
            self._texts_key = snapshot, (fixed, selected, self._hint)
            self._panel.show_texts(overview(snapshot, self._source, fixed),
                                   details(snapshot, selected, self._source))

    async def _look_at_all(self, client: viser.ClientHandle) -> None:
        """Move the camera of a client so that all frames are visible."""
        self._scene.look_at(self._snapshot, [client])

    def _turn_cameras(self, now: float) -> None:
        """Move the cameras of all clients once, `_SETTLING` seconds after the first frame."""
        if self._turn_at is None and self._snapshot.names:
            self._turn_at = now + _SETTLING
        if self._turn_at is not None and now >= self._turn_at:
            self._turn_at = np.inf
            self._scene.look_at(self._snapshot, self._server.get_clients().values())
