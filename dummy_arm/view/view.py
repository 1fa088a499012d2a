"""What is seen: brought up to date again and again, as those who look have chosen."""

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

_BETWEEN_TEXTS = 0.2  # s
_SETTLING = 1.0  # s, until the frames that come first have all come
_TRAIL_STEP = SECOND // 20
_TRAIL_GAP = 4 * _TRAIL_STEP


class Trail:
    """Draws the path of a frame again and again; what was drawn before stays as it is."""

    def __init__(self, buffer: AnyBuffer) -> None:
        """Begin with no frame."""
        self._buffer = buffer
        self._begin('', '')

    def _begin(self, target: str, frame: str) -> None:
        self._of = target, frame
        self._times = np.empty(0, np.int64)
        self._points = np.empty((0, 3))

    def draw(self, target: str, frame: str, end: int, point: NDArray[np.float64]
             ) -> NDArray[np.float64]:
        """
        Draw the path of a frame.

        :param target: the frame in which it is drawn.
        :param end: its last time (ns).
        :param point: where it is then, (3,): x, y, z (m).
        :returns: (m, 2, 3): lines from point to point (m), the oldest first; without those to
            times at which nothing is known.
        """
        first = max(1, end - LENGTH * SECOND)
        last = max(self._times[-1:].tolist(), default=first)
        if self._of != (target, frame) or last > max(end, first):  # time was set back
            self._begin(target, frame)
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
    """A page of frames."""

    def __init__(self, source: Source, server: Server) -> None:
        """Make the page; `update` fills it."""
        self._source, self._player = source, source.player
        self._watcher = FrameWatcher(source.buffer)
        self._snapshot, self._fixed = self._watcher.snapshot(), ''
        self._scene = Scene(server)
        self._panel = Panel(server.gui, self._player.length if self._player else 0.0,
                            self._look_at_all)
        server.on_client_connect(self._look_at_all)
        self._trail = Trail(source.buffer)
        #: What it was drawn of, and its lines.
        self._trail_of: tuple[Optional[Snapshot], str] = None, ''
        self._lines = np.empty((0, 2, 3))
        self._next_texts = 0.0
        self._texts_of: tuple[Optional[Snapshot], tuple[str, str]] = None, ('', '')
        #: When those who came before the frames are turned to them.
        self._turn_at: Optional[float] = None
        self._server = server

    def update(self) -> None:
        """Show what there is now."""
        panel, now = self._panel, monotonic()
        until = self._advance() if self._player else 0
        fixed = panel.fixed.chosen
        latest = self._watcher.snapshot(fixed, until)
        if self._player or not panel.is_paused or fixed != self._fixed:
            self._snapshot, self._fixed = latest, fixed
        snapshot = self._snapshot
        panel.set_frames(snapshot)
        if clicked := self._scene.take_click():
            panel.selected.choose(clicked)
        self._draw_trail(panel.trail.name)
        self._scene.show(snapshot, panel.size, panel.selected.name, panel.with_names, self._lines)
        self._update_texts(now, fixed, panel.selected.name)
        self._turn_cameras(now)

    def _advance(self) -> int:
        """Go on in a bag; tell the time (ns)."""
        player, sought = self._player, self._panel.take_requested_time()
        assert player is not None
        player.advance(not self._panel.is_paused)
        if sought is not None:
            player.seek(sought)
        self._panel.show_time(player.position)
        return player.time

    def _draw_trail(self, name: str) -> None:
        """Draw the path of a frame, unless that is drawn already."""
        snapshot = self._snapshot
        if snapshot is self._trail_of[0] and name == self._trail_of[1]:
            return
        self._trail_of, self._lines = (snapshot, name), np.empty((0, 2, 3))
        if name in snapshot.names:
            i = snapshot.names.index(name)
            target, y = snapshot.anchor_of(name)
            if snapshot.ages[i] < TIMEOUT:
                self._lines = within_reach(np.array([0.0, y, 0.0]) + self._trail.draw(
                    target, name, snapshot.stamps[i], snapshot.poses[i, :3]))

    def _update_texts(self, now: float, fixed: str, selected: str) -> None:
        """Tell of the frames, now and then, unless that is told already."""
        snapshot, before = self._snapshot, self._texts_of
        is_new = snapshot is not before[0] or (fixed, selected) != before[1]
        if is_new and now >= self._next_texts:
            self._next_texts = now + _BETWEEN_TEXTS
            self._texts_of = snapshot, (fixed, selected)
            self._panel.show_texts(overview(snapshot, self._source, fixed),
                             details(snapshot, selected, self._source))

    async def _look_at_all(self, client: viser.ClientHandle) -> None:
        """Turn somebody's camera to all frames."""
        self._scene.look_at(self._snapshot, [client])

    def _turn_cameras(self, now: float) -> None:
        """Turn the cameras of those who came before the frames, when all have been heard of."""
        if self._turn_at is None and self._snapshot.names:
            self._turn_at = now + _SETTLING
        if self._turn_at is not None and now >= self._turn_at:
            self._turn_at = np.inf
            self._scene.look_at(self._snapshot, self._server.get_clients().values())
