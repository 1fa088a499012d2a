"""An animation of the scene, which plays in a browser without a server."""

from collections.abc import Callable, Sequence
from math import ceil
from socket import create_server
import sys
from time import monotonic

import numpy as np

from puretf import SECOND
from puretf_tools.cli.progress import BAR, listen, progress
from puretf_tools.cli.signals import forget_signals
from puretf_tools.view.axes_and_trail import Display, Pieces, trail
from puretf_tools.view.camera import look_at
from puretf_tools.view.feed import Feed
from puretf_tools.view.meshes import Meshes
from puretf_tools.view.placement import FrameWatcher, Placement
from puretf_tools.view.scene import MOST_NAMES, Scene
from puretf_tools.view.viser_private import Server, with_head

#: The time between two moments of an animation (s).
PERIOD = 0.05


class Animation:
    """What the scene shows at some moments, for a page without a server."""

    def __init__(self, feed: Feed, meshes: Sequence[str] = ()) -> None:
        self._feed, self._meshes = feed, Meshes(meshes, waits=True)
        self._watcher = FrameWatcher(feed.buffer)
        #: The time of each (s), the frames, and the trail.
        self.moments: list[tuple[float, Placement, Pieces]] = []
        self.problems: Sequence[str] = ()  #: of the page: a line for each mesh that is not drawn

    @property
    def duration(self) -> float:
        return self.moments[-1][0] - self.moments[0][0] if self.moments else 0.0

    def add(self, time: float, until: int = 0) -> None:
        """Add a moment (s), if there are frames; `until`: the time of a bag (ns), or 0."""
        self._feed.descriptions()  # it searches for them
        placement = self._watcher.placement('', until)
        if placement.names:
            self.moments.append((time, placement, trail(
                self._feed.buffer, placement, placement.deepest, Display())))

    def record(self, seconds: float) -> None:
        """Add the first seconds of a bag, or what is live, from the first transform on."""
        player = self._feed.player
        if player is None:
            listen(seconds, self._feed.buffer.frames, lambda: self.add(monotonic()))
            forget_signals()
            return
        length = min(seconds, player.length)
        with progress(length, desc='recording', bar_format=BAR) as show_progress:
            for i in range(ceil(length / PERIOD) + 1):
                player.seek(player.begin + round(min(length, i * PERIOD) * SECOND))
                self.add(player.position, player.time)
                show_progress(player.position)

    def as_html(self, on_progress: Callable[[float], object] = lambda done: None) -> str:
        """Return the page; `on_progress` is called with the time of each moment (s)."""
        server = Server(create_server(('127.0.0.1', 0)), lambda headers: 'there is no page here')
        try:
            descriptions, follow = self._feed.descriptions(), self._feed.follow
            scene = Scene(server, self._meshes)
            scene.body.at_a_time = sys.maxsize  # nobody waits
            # Only the first position of the camera counts: it shows where all frames will go.
            look_at(np.concatenate([
                scene.seen(placement, Display().shown(placement))
                for _, placement, _ in self.moments[:1 if follow else None]]),
                    [server.initial_camera])
            serializer, before = server.get_scene_serializer(), self.moments[0][0]
            for time, placement, pieces in self.moments:
                on_progress(time - self.moments[0][0])
                serializer.insert_sleep(time - before)
                scene.show(placement, Display(with_names=len(placement.names) <= MOST_NAMES),
                           placement.deepest, pieces, descriptions, follow)
                scene.move()
                before = time
            _, self.problems = scene.body.lines()
            serializer.insert_sleep(PERIOD)  # before the loop begins again
            return with_head(serializer.as_html(), self._feed.name)
        finally:
            server.stop()
