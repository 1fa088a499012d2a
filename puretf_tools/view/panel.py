"""The panels beside the scene: the controls and texts of one viewer."""

from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
import json
from pathlib import Path
from typing import Any, Optional

import viser

from puretf_tools.view.axes_and_trail import Display
from puretf_tools.view.camera import VIEWS
from puretf_tools.view.controls import (
    add_keys,
    AUTOMATIC,
    Choice,
    copied,
    FrameChoice,
    html,
    LAST,
)
from puretf_tools.view.feed import Feed, LENGTH
from puretf_tools.view.hand_frame import HandFrame
from puretf_tools.view.pair import Pair
from puretf_tools.view.placement import Placement, TIMEOUT
from puretf_tools.view.playback import Playback
from puretf_tools.view.robot_tab import RobotTab
from puretf_tools.view.scene import MOST_NAMES
from puretf_tools.view.settings import Settings
from puretf_tools.view.tree_and_findings import Findings, has_words, Tree, words_of

#: This long (s) after the first dynamic frame has appeared, most others have.
SETTLING = 1.0
#: A change of the frames in a dropdown sends all names to all viewers. So after a change with n
#: names, the next change waits for n times this (s).
_OPTION_PERIOD = 0.5e-3
#: Red, green, blue of the buttons, by whether the page is dark: viser's own are too light for
#: white text.
_BRANDS = (10, 70, 145), (95, 150, 225)
#: HTML for what viser lacks.
_ADDITIONS = (Path(__file__).parent / 'additions.html').read_text()
#: Where the panels are at first: the side, x and y (pixels from the scene), the width (pixels;
#: 0: as it is), and whether they are folded.
_PLACES = {'main': ['right', 0.0, 0.0, 360.0, False], 'tree': ['left', 0.0, 0.0, 350.0, False]}
_STEP = 0.1  # back or forward (s)


class Panel:
    """The controls and texts of one viewer."""

    def __init__(self, client: viser.ClientHandle, feed: Feed, settings: Settings,
                 look_from: Callable[[str], Awaitable[object]],
                 playback: Optional[Playback] = None) -> None:
        """
        Add the controls.

        :param look_from: moves the camera to a view, or to the selected 'frame'.
        :param playback: the controls of a bag.
        """
        gui = client.gui
        configure(gui, False)
        gui.add_html(_ADDITIONS)
        self._settings = settings
        self._options: list[str] = []  # of the dropdowns
        self._proposal = ''  # the frame with details and a trail, until the viewer chooses
        self._settled: Optional[float] = None  # `SETTLING` after the first dynamic frame
        self._next_options = 0.0  # when they may change again (s, monotonic clock)
        self._look_from, self._feed = look_from, feed
        panel = gui.add_panel()
        self.tree = Tree(gui, panel.add_tab('Tree'), settings, partial(look_from, 'frame'))
        self.findings = Findings(gui, panel.add_tab('Findings'), feed)
        self._panels = {'main': gui.main_panel, 'tree': panel}
        self.put_panels()
        self._pause: Any = None
        if feed.player is None:
            self._pause = gui.add_checkbox('Pause', False)
            self.back = gui.add_slider('Back (s)', 0.0, LENGTH, _STEP, 0.0, disabled=True)
            self._pause.on_update(self._on_pause)
            gui.add_button_group('Transforms', ('reset',)).on_click(lambda _: feed.reset())
        self.fixed = FrameChoice(gui, 'Fixed frame', AUTOMATIC, settings)
        add_keys(gui, playback or self, self._on_view, self._on_reset_view)
        gui.add_button_group('View', tuple(VIEWS)).on_click(self._on_view)
        tabs = gui.add_tab_group()
        self.robot = RobotTab(gui, tabs, feed.joint_controls)
        with tabs.add_tab('Frame'):
            self.selected = FrameChoice(gui, 'Frame', settings=settings)
            self.trail = FrameChoice(gui, 'Trail of', settings=settings)
            self.follow = FrameChoice(gui, 'Follow', settings=settings)
            self.follows_yaw = settings.control(gui.add_checkbox('Follow its yaw', False))
            self.details = gui.add_html('')
        with tabs.add_tab('Display'):
            self.display = DisplayPanel(gui, settings)
            self._add_view_controls(gui)
        with tabs.add_tab('Pair'):
            self.pair = Pair(gui, settings, feed)
        with tabs.add_tab('By hand'):
            self.hand_frame = HandFrame(gui, client.scene, feed.hand_publisher)
        self.overview = gui.add_html('', order=LAST)
        self._frame_choices = [self.fixed, self.selected, self.trail, self.follow,
                               *self.pair.choices, self.hand_frame.parent]

    def put_panels(self, stored: Optional[str] = None) -> None:
        """Put the panels where they were, as the browser has stored it, or are at first."""
        with suppress(Exception):  # it may have stored anything
            for name, place in {**_PLACES, **json.loads(stored or '{}')}.items():
                panel, (side, x, y, width, is_folded) = self._panels[name], place
                if side == 'float':
                    panel.float(x=x, y=y)
                else:
                    beside = [self._panels['main']] if side in ('above', 'below') else []
                    getattr(panel, f'dock_{side}')(*beside)
                if width:
                    panel.set_width(width)
                if is_folded:
                    panel.minimize()

    def _add_view_controls(self, gui: viser.GuiApi) -> None:
        gui.add_button('Copy view').on_click(self._on_copy)
        self._copied = gui.add_html('')
        gui.add_text('Paste view', '').on_update(self._on_paste)
        self._problem = gui.add_html('')
        gui.add_button('Reset view').on_click(self._on_reset_view)

    async def _on_copy(self, _: Any) -> None:
        self._copied.content = html('Click the line to select it, and copy it:', 'copy') + copied(
            self._settings.as_json(), 'view')

    async def _on_paste(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None and event.target.value:
            self._problem.content = html(self._settings.restore(event.target.value), 'paste')
            event.target.value = ''

    async def _on_reset_view(self, _: Any) -> None:
        self._settings.reset()
        self.put_panels()
        for panel in self._panels.values():
            panel.expand()

    async def _on_view(self, event: Any, view: str = '') -> None:
        await self._look_from(view or event.target.value)

    @property
    def is_paused(self) -> bool:
        return self._pause is not None and self._pause.value

    async def _on_pause(self, event: 'viser.GuiEvent[Any]') -> None:
        self.back.disabled = not event.target.value
        if self.back.disabled:
            self.back.value = 0.0

    async def on_pause(self, _: Any) -> None:
        """Pause or resume."""
        self._pause.value = not self._pause.value

    async def on_step(self, is_back: bool, _: Any) -> None:
        """Pause, and look further back, or less."""
        self.look_back(self.back.value + (_STEP if is_back else -_STEP))

    def look_back(self, seconds: float) -> None:
        """Pause, and look back."""
        self._pause.value = True
        self.back.value = min(max(seconds, 0.0), LENGTH)

    def set_frames(self, placement: Placement, now: float) -> None:
        """
        Set the dropdowns and the checkbox 'Show names'.

        Until the viewer uses the checkbox, it is ticked if there are at most `MOST_NAMES`
        frames.
        """
        # A bag is played again and again, so its frames stay in the dropdowns.
        before = self._options if self._feed.player else []
        names = [*dict.fromkeys([*before, *placement.names])]
        if names != self._options and now >= self._next_options:
            self._options, self._next_options = names, now + len(names) * _OPTION_PERIOD
            for choice in self._frame_choices:
                choice.set_options(names)
        self.fixed.propose(placement.fixed)
        self.follow.propose(self._feed.follow)
        # While the first dynamic frames appear, the proposal follows the deepest one; then it
        # stays.
        if self._settled is None and not all(
                frame.is_static for frame in placement.frames.values()):
            self._settled = now + SETTLING
        if now <= (self._settled or now) or self._proposal not in placement.names:
            self._proposal = placement.deepest
        for choice in self.trail, self.selected:
            choice.propose(self._proposal)
        self.display.names.propose(len(placement.names) <= MOST_NAMES)


class DisplayPanel:
    """The controls of a `Display`."""

    def __init__(self, gui: viser.GuiApi, settings: Settings) -> None:
        """Add the controls to the current container."""
        self._gui = gui
        self._include, self._exclude = (
            settings.control(gui.add_text(label, '')) for label in ('Include', 'Exclude'))
        axes = settings.control(gui.add_checkbox('Axes', True))
        size = settings.slider(gui, 'Axis length (m)', 0.02, Display().size)
        lines = settings.control(gui.add_checkbox('Lines to parents', True))
        self.names = Choice(gui.add_checkbox('Show names', True), settings)
        grid = settings.control(gui.add_checkbox('Grid', True))
        self.timeout = settings.slider(gui, 'Frame timeout (s)', 1.0, TIMEOUT)
        dark = settings.control(gui.add_checkbox('Dark', False))
        dark.on_update(self._on_dark)
        bodies = [*map(settings.control, (
            gui.add_checkbox('Visual', True), gui.add_checkbox('Collision', False))),
            settings.slider(gui, 'Opacity', 0.05, 1.0)]
        #: In the order of a `Display`.
        self._drawn = size, axes, lines, self.names, grid, dark, *bodies

    def passes(self) -> Callable[[str], bool]:
        """Return a function that says whether the name of a frame passes the filters."""
        include, exclude = (words_of(box.value) for box in (self._include, self._exclude))
        return lambda name: has_words(name, include) and not (
            exclude and has_words(name, exclude))

    async def _on_dark(self, event: 'viser.GuiEvent[Any]') -> None:
        configure(self._gui, bool(event.target.value))

    def display(self, hidden: frozenset[str]) -> Display:
        """Return what is to be drawn, without some frames."""
        return Display(hidden, *(control.value for control in self._drawn))


def configure(gui: viser.GuiApi, is_dark: bool) -> None:
    """Set the theme of a viewer."""
    gui.configure_theme(dark_mode=is_dark, show_logo=False, show_share_button=False,
                        control_width='large', brand_color=_BRANDS[is_dark])
