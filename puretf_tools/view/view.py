"""The page: the scene and the panels, updated from a feed, and the bar at the foot of a bag."""

from argparse import ArgumentTypeError
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache, lru_cache, partial
from threading import Thread
from time import monotonic
from typing import Any, Optional
from zlib import crc32

import numpy as np
import viser

from puretf import SECOND, TransformBuffer
from puretf._text.names import abbreviated, visible
from puretf_tools.cli.signals import sleep, wait_until
from puretf_tools.cli.times import when
from puretf_tools.inspection.bag_times import both, why_outside
from puretf_tools.inspection.gaps import AnyBuffer
from puretf_tools.view.axes_and_trail import Display, trail
from puretf_tools.view.camera import FirstCamera, look_at, VIEWS
from puretf_tools.view.controls import change, values
from puretf_tools.view.details import details, overview
from puretf_tools.view.feed import BagFeed, Descriptions, Feed, LENGTH
from puretf_tools.view.meshes import Meshes
from puretf_tools.view.panel import Panel
from puretf_tools.view.placement import FrameWatcher, Placement
from puretf_tools.view.scene import Scene
from puretf_tools.view.settings import Settings
from puretf_tools.view.viser_private import LONGEST, PAGE, receive_at_once, Server

#: The time between two updates of texts and plots, and of what the browser stores (s).
_TEXT_PERIOD = 0.4
#: The interval between two updates of the page (s): `_UPDATE_PERIOD` while a browser shows the
#: page, `_IDLE_PERIOD` while no browser shows it.
_UPDATE_PERIOD, _IDLE_PERIOD = 1 / 30, 0.5
#: After an update that took long, since there are many frames, the page rests for this many times
#: as long. Meanwhile viser sends the changes to the viewers.
_REST = 4.0
#: The largest size of a view that is stored (ASCII): a browser sends it back in a message.
_LONGEST_STORED = LONGEST - 1024
#: The speeds, from 0.1 to 10 times that of the recording.
_SPEEDS = '0.1', '0.2', '0.5', '1', '2', '5', '10'
#: The number of moments that the first camera shows.
_MOMENTS = 20

Place = Callable[[str, int, float], Placement]


def show(feed: Feed, server: Server, meshes: Sequence[str] = (), view: str = '') -> None:
    """Show a feed until a signal; see `View`."""
    shown = View(feed, server, meshes=meshes, view=view)
    while True:
        start = monotonic()
        shown.update()
        spent = monotonic() - start
        sleep(max(_UPDATE_PERIOD - spent, _REST * spent))
        wait_until(_IDLE_PERIOD, server.get_clients)


class View:
    """The page: the frames, and what each of its viewers has chosen."""

    def __init__(self, feed: Feed, server: Server, clock: Callable[[], float] = monotonic,
                 meshes: Sequence[str] = (), view: str = '') -> None:
        """
        Show a feed.

        :param meshes: the directories with the meshes of robots.
        :param view: what viewers see at first, as a line of JSON.
        """
        self._feed, self._clock, self._server, self._first = feed, clock, server, view
        self._meshes = Meshes(meshes)
        self._watcher = FrameWatcher(feed.buffer, clock)
        self._playback = Playback(feed) if isinstance(feed, BagFeed) else None
        self.viewers: dict[int, Viewer] = {}
        server.gui.set_panel_label(feed.name)
        server.title = feed.name

    def update(self) -> None:
        """Read the feed and the panels, and update what each viewer sees."""
        now = self._clock()
        clients = self._server.get_clients()
        until = self._playback.update(bool(clients)) if self._playback else 0
        self._feed.watch(now)  # the listener drops the oldest messages if nobody looks
        descriptions = self._feed.descriptions()
        self._feed.joint_controls.update(descriptions)
        for gone in self.viewers.keys() - clients.keys():
            self.viewers.pop(gone).close()
        place = cache(self._watcher.placement)
        for number, client in clients.items():
            try:
                viewer = self._viewer(number, client, is_alone=len(clients) == 1)
                if not viewer.pace.is_waiting:
                    viewer.update(place, until, now, descriptions)
            except Exception as error:  # whatever the data of one viewer raise, the others stay
                self._server.end_session(number, error)
        if not until and not place.cache_info().currsize:
            self._watcher.watch()

    def _viewer(self, number: int, client: viser.ClientHandle, is_alone: bool) -> 'Viewer':
        if number not in self.viewers:
            self._meshes.forget_failures()
            self.viewers[number] = Viewer(client, self._feed, self._server.initial_camera,
                                          self._meshes, self._first, is_alone, self._playback)
        viewer, player = self.viewers[number], self._feed.player
        if not viewer.has_path and (not player or (player.is_whole and player.length)):
            viewer.has_path = True
            end = player.end if player else max(1, _newest(self._feed.buffer))
            begin = player.begin if player else max(1, end - 2 * LENGTH * SECOND)
            for time in np.linspace(begin, end, _MOMENTS).astype(np.int64).tolist():
                placement = self._watcher.placement('', time)
                viewer.first_camera.extend(
                    placement.points[[name not in placement.far for name in placement.names]])
        return viewer


def _newest(buffer: AnyBuffer) -> int:
    return max((frame.latest for frame in buffer.frames()), default=0)


class Playback:
    """The clock of a bag, as the bar at the foot shows and sets it; all viewers share it."""

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


class Viewer:
    """What one viewer sees: a scene and a panel."""

    def __init__(self, client: viser.ClientHandle, feed: Feed, initial_camera: Any,
                 meshes: Meshes, first: str, is_alone: bool, playback: Optional[Playback]) -> None:
        #: The camera of the viewer, and the one to which viewers can reset theirs.
        self._cameras, self._feed = (client.camera, initial_camera), feed
        receive_at_once(client)
        self._client, self._is_alone = client, is_alone
        self.has_path = False  #: whether the first camera knows where the frames go
        self._click = [0.0, 0.0]  # in a plot: its number, and the time there (s)
        #: The time that is shown, and of a bag, the one that is wanted (ns); 0: the latest.
        self._until = self._goal = 0
        #: What the viewer has done: an action, and what it is about.
        self._events = deque[tuple[str, str]](maxlen=100)
        self._scene = Scene(client, meshes, self._send)
        self._settings = Settings(first)
        self._panel = Panel(client, feed, self._settings, self._send)
        self._playback = playback
        #: Places the frames of the last seconds before a pause; None: the page is not paused, or
        #: there are no frames.
        self._place_paused: Optional[Place] = None
        self._buffer = feed.buffer
        self._next_texts = 0.0  # when they are updated (s, monotonic clock); 0.0: at once
        self.first_camera = FirstCamera(self._cameras)
        self._settings.add('Camera', lambda: self.first_camera.view, self.first_camera.restore)
        if feed.player:
            self._settings.add('Time', lambda: self._until, partial(setattr, self, '_goal'))
        # For another `--view`, the browser has stored nothing yet.
        self.pace = Pace(client, f'{feed.name} {crc32(first.encode())}')

    def _send(self, action: str, what: str) -> None:
        self._events.append((action, what))

    def _restore(self) -> None:
        if why := self._settings.reset(self.pace.stored or ''):
            self._client.add_notification('The view that was kept is refused', why)
        if not self._is_alone:  # somebody else has chosen the time of the bag
            self._goal = 0

    def close(self) -> None:
        """Stop what the viewer has started, after they have left."""
        self._panel.hand_frame.stop()

    def _place(self, place: Place, until: int) -> Placement:
        """Return the frames to show; while they are paused, those of a copy of the buffer."""
        panel = self._panel
        if not panel.is_paused:
            self._buffer, self._place_paused = self._feed.buffer, None
        elif not self._place_paused and _newest(self._feed.buffer):
            self._buffer = TransformBuffer.copy_of(self._feed.buffer)
            self._place_paused = lru_cache(1)(FrameWatcher(self._buffer).placement)
        self._until = max(1, _newest(self._buffer) - round(panel.back.value * SECOND)) if (
            self._place_paused) else until
        return (self._place_paused or place)(
            panel.fixed.chosen, self._until, panel.display.timeout.value)

    def update(self, place: Place, until: int, now: float, descriptions: Descriptions) -> None:
        """
        Show the frames; the viewer must be due.

        :param place: as `FrameWatcher.placement`.
        :param until: the time of a bag (ns); 0: the frames are live.
        :param now: on the monotonic clock (s).
        """
        panel = self._panel
        if self.pace.error:
            raise self.pace.error
        if self._scene.shown is None:
            self._restore()
        width, height, *click = self.pace.page
        self._client.camera.page_size = width, height
        if click != self._click:
            self._click = click
            self._go_to(panel.pair.time_at(click[1]))
        if self._goal and (player := self._feed.player) and player.is_whole:
            player.seek(self._goal)
            self._goal = 0
        if self._scene.shown:
            self._take_events(self._scene.shown[0])
        change(panel.bar, content=self._playback.content if self._playback else '')
        placement = self._place(place, until)
        panel.set_frames(placement)
        selected = panel.selected.value
        hidden = panel.tree.hidden(placement, panel.display.include.value)
        display = panel.display.display(hidden)
        self._scene.show(placement, display, selected,
                         trail(self._buffer, placement, panel.trail.value, display), descriptions,
                         panel.follow.value, panel.follows_yaw.value,
                         panel.pair.frames if panel.pair.shown else ())
        panel.hand_frame.update(placement)
        if now >= self._next_texts:
            self._next_texts = now + _TEXT_PERIOD
            self._show_texts(placement, selected, hidden, now)
        self.first_camera.update(
            lambda: self._scene.seen(placement, Display().shown(placement)), now)
        self.pace.when_handled(self._scene.move)

    def _show_texts(self, placement: Placement, selected: str, hidden: frozenset[str], now: float
                    ) -> None:
        """Update what changes less often than the scene, and let the browser store the view."""
        panel = self._panel
        panel.tree.update(placement, selected, hidden, self._scene.body.progress, now)
        change(panel.overview, content=overview(placement, self._feed, panel.fixed.chosen))
        change(panel.details, content=details(placement, selected, self._feed, self._buffer))
        panel.show_robot(*self._scene.body.lines())
        panel.pair.update(self._buffer, self._until)
        self.pace.store(self._settings.as_json())

    def _go_to(self, time: int) -> None:
        if player := self._feed.player:
            player.stop_at(time)
        else:
            self._panel.look_back((_newest(self._buffer) - time) / SECOND)

    def _take_events(self, placement: Placement) -> None:
        """Do what the viewer has requested in the page, and select what is clicked there."""
        panel, selected = self._panel, self._panel.selected
        while self._events:
            action, what = self._events.popleft()
            self._next_texts = 0.0
            name = next((each for each in placement.names if what in (each, visible(each))),
                        selected.value)
            if action == 'view':
                self._look_from(what)
            elif action == 'finding':
                self._choose(what)
            elif action in ('hide', 'branch', 'fold'):
                panel.tree.sets[action] ^= {name}
            elif action == 'select':
                selected.choose(name)
            elif action == 'pair':
                panel.pair.choose(selected.value, name)
            elif self._playback and action != 'kept':
                self._playback.act(action, what)
            else:
                panel.act(action, what)

    def _choose(self, title: str) -> None:
        """Select the first frame of a finding, and go to its time."""
        selected = self._panel.selected
        for finding in self._feed.findings:
            if self._panel.tree.title(finding) == title:
                selected.choose(next(iter(finding.frames), selected.value))
                if self._feed.player and finding.time:
                    self._go_to(finding.time)

    def _look_from(self, view: str) -> None:
        """Move the cameras so that the frames that are drawn, or the selected one, are visible."""
        if self._scene.shown:
            placement, display, _ = self._scene.shown
            shown = display.shown(placement) if view in VIEWS else (
                Display().shown(placement) & {self._panel.selected.value})
            look_at(self._scene.seen(placement, shown), self._cameras,
                    VIEWS.get(view, VIEWS['all']))
            self.first_camera.is_over = True


class Pace:
    """
    Waits for a viewer, so that updates do not queue on a slow link or in a slow browser.

    A browser handles all messages in their order. So when it answers a question about its storage,
    it has handled the update that was sent before.
    """

    def __init__(self, client: viser.ClientHandle, key: str) -> None:
        """Read what the browser has stored under a key; meanwhile, the viewer is waited for."""
        self._storage, self._key = client.local_storage, key
        self.stored: Optional[str] = None  #: the view, as the browser has stored it
        self.page = [0.0, 0.0, 0.0, 0.0]  #: what head.html says; see there
        self.error: Optional[Exception] = None  #: what a move has raised
        self.when_handled(self._read)

    def when_handled(self, move: Callable[[], object]) -> None:
        """Call a function in another thread, as soon as what was sent before has been handled."""
        self.is_waiting = True  #: until the last update has been handled
        Thread(target=self._wait, args=(move,), daemon=True).start()

    def store(self, text: str) -> None:
        """Let the browser store a text, in place of the one before, if it can send it back."""
        if text != self.stored and len(text) < _LONGEST_STORED:
            self.stored = text
            self._storage.set_item(self._key, text)

    def _read(self) -> None:
        with suppress(RuntimeError):  # the storage is blocked, or the viewer has left
            self.stored = self._storage.get_item(self._key)

    def _wait(self, move: Callable[[], object]) -> None:
        try:
            with suppress(RuntimeError):  # as in `_read`
                page = [*map(float, (self._storage.get_item(PAGE) or '').split())]
                if len(page) == len(self.page):
                    self.page = page
            move()
        except Exception as error:
            self.error = error
        self.is_waiting = False
