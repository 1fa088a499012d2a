"""The panel beside the scene: the controls and texts of one viewer."""

from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any, Optional

import viser

from puretf_tools.view.axes_and_trail import Display
from puretf_tools.view.camera import VIEWS
from puretf_tools.view.controls import AUTOMATIC, change, Choice, copied, FrameChoice, html
from puretf_tools.view.feed import Feed, LENGTH
from puretf_tools.view.hand_frame import HandFrame
from puretf_tools.view.pair import Pair
from puretf_tools.view.placement import Placement, TIMEOUT
from puretf_tools.view.robot_tab import RobotTab
from puretf_tools.view.scene import MOST_NAMES
from puretf_tools.view.settings import Settings
from puretf_tools.view.tree_and_findings import Tree
from puretf_tools.view.viser_private import uuid_of

#: HTML for what viser lacks.
_STYLE, _SCRIPT = ((Path(__file__).parent / f'page.{kind}').read_text() for kind in ('css', 'js'))
_ADDITIONS = f'<style onload="{escape(_SCRIPT)}">{_STYLE}</style>'
_STEP = 0.1  # back or forward (s)
_PAUSE, _RESUME, _RESET = 'pause', 'resume', 'reset'
_COPY, _PASTE, _RESET_VIEW = 'copy view', 'paste view', 'reset view'
#: The keys: what viser's list of commands says of each, and the event.
_KEYS = {'P': ('Pause or resume', 'pause', ''), 'B': ('Step back', 'step', 'back'),
         'N': ('Step forward', 'step', 'next'), 'A': ('Focus on all frames', 'view', 'all'),
         'F': ('Focus on the selected frame', 'view', 'frame'),
         'T': ('Look from the top', 'view', 'top'),
         'H': ('Hide or show the selected frame', 'hide', ''),
         'R': ('Reset view', 'kept', _RESET_VIEW)}


class Panel:
    """The controls and texts of one viewer."""

    def __init__(self, client: viser.ClientHandle, feed: Feed, settings: Settings,
                 send: Callable[[str, str], object]) -> None:
        """Add all controls; `send`: called with an action of the viewer, and what it is about."""
        gui, self._send = client.gui, send
        gui.add_html(_ADDITIONS)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(300.0)  # pixels
        self._settings, self._feed, self.is_paused = settings, feed, False
        self._options: list[str] = []  # of the dropdowns
        page = gui.add_text('', '', visible=False)
        page.on_update(self._on_page)
        # What page.js reads is in a panel that nobody sees or folds: what is folded is not there.
        unseen = gui.add_panel()
        unseen.float(x=0.0, y=0.0)
        with unseen.add_tab(''):
            self.tree = Tree(gui.add_html(''), settings, feed, uuid_of(page))
            self.bar = gui.add_html('')
        gui.add_html('<div class="tf-page"></div>')
        self.overview = gui.add_html('')
        if feed.player is None:
            self._live = gui.add_button_group('Live', (_PAUSE, _RESET))
            self._live.on_click(self._put('live'))
            self.back = gui.add_slider('Back (s)', 0.0, LENGTH, _STEP, 0.0, visible=False)
        self.fixed = FrameChoice(gui, 'Fixed frame', AUTOMATIC, settings)
        for key, (text, *event) in _KEYS.items():
            gui.add_command(text, hotkey=key).on_trigger(self._put(*event))
        gui.add_button_group('View', tuple(VIEWS)).on_click(self._put('view'))
        tabs = gui.add_tab_group()
        self._add_robot = lambda: RobotTab(gui, tabs.add_tab('Robot'), feed.joint_controls)
        self._robot = self._add_robot() if feed.joint_controls.come_first else None
        with tabs.add_tab('Frame'):
            self.selected = FrameChoice(gui, 'Frame', settings=settings)
            self.trail = FrameChoice(gui, 'Trail of', settings=settings)
            self.follow = FrameChoice(gui, 'Follow', settings=settings)
            self.follows_yaw = settings.control(gui.add_checkbox('Follow its yaw', False))
            self.details = gui.add_html('')
        with tabs.add_tab('Display'):
            self.display = DisplayPanel(gui, settings)
            gui.add_button_group('', (_COPY, _PASTE, _RESET_VIEW)).on_click(self._put('kept'))
            self._paste = gui.add_text('Paste view', '', visible=False)
            self._paste.on_update(self._on_paste)
            self._kept = gui.add_html('')
        with tabs.add_tab('Pair'):
            self.pair = Pair(gui, settings, feed)
        with tabs.add_tab('By hand'):
            self.hand_frame = HandFrame(gui, client.scene, feed.hand_publisher)
        self._frame_choices = [self.fixed, self.selected, self.trail, self.follow,
                               *self.pair.choices, self.hand_frame.parent]

    async def _on_page(self, event: 'viser.GuiEvent[Any]') -> None:
        # A number, the action, and what it is about: of others, nothing is known by this name.
        action, _, what = event.target.value.partition(' ')[2].partition(' ')
        self._send(action, what)

    def _put(self, action: str, what: Optional[str] = None) -> Callable[[Any], Awaitable[None]]:
        """Return a callback that sends an action; None: about the button of a group."""
        async def put(event: Any) -> None:
            self._send(action, event.target.value if what is None else what)
        return put

    async def _on_paste(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None and event.target.value:
            self._kept.content = html(self._settings.restore(event.target.value), 'paste')
            event.target.value = ''

    def act(self, action: str, what: str) -> None:
        """Do what the viewer requests: of the view, or of the time of a live page."""
        if action == 'kept':
            change(self._paste, visible=what == _PASTE)
            self._kept.content = '' if what != _COPY else copied(
                self._settings.as_json(), 'view')
            if what == _RESET_VIEW:
                self._settings.reset()
        elif what == _RESET:
            self._feed.buffer.clear()
        elif action == 'step':
            self.look_back(self.back.value + (_STEP if what == 'back' else -_STEP))
        elif action in ('live', 'pause'):
            self.look_back(0.0, not self.is_paused)

    def look_back(self, seconds: float, is_paused: bool = True) -> None:
        self.is_paused = is_paused
        change(self._live, options=(_RESUME if is_paused else _PAUSE, _RESET))
        change(self.back, visible=is_paused, value=min(max(seconds, 0.0), float(LENGTH)))

    def show_robot(self, lines: Sequence[str], folded_lines: Sequence[str]) -> None:
        """Show lines about descriptions and meshes, and the joints, as soon as there is a line."""
        if lines and not self._robot:
            self._robot = self._add_robot()
        if self._robot:
            self._robot.update(lines, folded_lines)

    def set_frames(self, placement: Placement) -> None:
        """Set the dropdowns, and what the viewer has not chosen."""
        # A bag is played again and again, so its frames stay in the dropdowns.
        before = self._options if self._feed.player else []
        names = [*dict.fromkeys([*before, *placement.names])]
        if names != self._options:
            self._options = names
            for choice in self._frame_choices:
                choice.set_options(names)
        self.fixed.propose(placement.fixed)
        self.follow.propose(self._feed.follow)
        for choice in self.trail, self.selected:
            choice.propose(placement.deepest)
        self.display.names.propose(len(placement.names) <= MOST_NAMES)


class DisplayPanel:
    """The controls of a `Display`."""

    def __init__(self, gui: viser.GuiApi, settings: Settings) -> None:
        self._set_theme = partial(gui.configure_theme, show_logo=False, show_share_button=False)
        self._set_theme()
        self.include = settings.control(gui.add_text('Include', ''))
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

    async def _on_dark(self, event: 'viser.GuiEvent[Any]') -> None:
        self._set_theme(dark_mode=event.target.value)

    def display(self, hidden: frozenset[str]) -> Display:
        return Display(hidden, *(control.value for control in self._drawn))
