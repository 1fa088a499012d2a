"""The panel beside the scene: the controls and texts of one viewer."""

from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import Any, Optional

import viser

from puretf_tools.view.body import BodyDisplay
from puretf_tools.view.controls import AUTOMATIC, FrameChoice, within
from puretf_tools.view.display import configure, DisplayPanel, RobotPanel
from puretf_tools.view.feed import Feed, LENGTH
from puretf_tools.view.hand_frame import HandFrame
from puretf_tools.view.joints import Joints
from puretf_tools.view.pair import Pair
from puretf_tools.view.placement import Placement
from puretf_tools.view.scene import MOST_NAMES
from puretf_tools.view.tree import Tree

#: This long (s) after the first dynamic frame has appeared, most others have.
SETTLING = 1.0
#: A change of the frames in a dropdown sends all names to all viewers. So after a change with n
#: names, the next change waits for n times this (s).
_OPTION_PERIOD = 0.5e-3


class Panel:
    """The controls and texts of one viewer."""

    def __init__(self, client: viser.ClientHandle, feed: Feed,
                 look_from: Callable[[str], Awaitable[object]]) -> None:
        """Add the controls; `look_from` moves the camera to one of `VIEWS`."""
        gui = client.gui
        configure(gui, False)
        self._options: list[str] = []  # of the dropdowns
        self._proposal = ''  # the frame with details and a trail, until the viewer chooses
        self._settled: Optional[float] = None  # `SETTLING` after the first dynamic frame
        self._next_options = 0.0  # when they may change again (s, monotonic clock)
        self._overview = gui.add_html('')
        self._pause: Any = None
        if feed.player is None:
            self._pause = gui.add_checkbox('Pause', False)
            self._back = gui.add_slider('Back (s)', 0.0, LENGTH, 0.1, 0.0,
                                        disabled=True,
                                        hint='shows an earlier time while the page is paused')
            self._pause.on_update(self._on_pause)
            gui.add_button('Reset', hint='forgets all transforms but the static ones, such as '
                           'those of before a jump in time').on_click(self._on_reset)
        self.fixed = FrameChoice(
            gui, 'Fixed frame', 'the frame in which the others are shown', AUTOMATIC)
        button = gui.add_button('Focus on all frames')
        button.on_click(partial(self._on_focus, 'all'))
        self._look_from, self._feed = look_from, feed
        tabs = gui.add_tab_group()
        self._gui, self._tabs, self._joint_controls = gui, tabs, feed.joint_controls
        #: None until there is a description of a robot.
        self._robot: Optional[RobotPanel] = None
        self._joints: Optional[Joints] = None
        if feed.joint_controls and feed.joint_controls.come_first:
            self._add_robot_tab()
        with tabs.add_tab('Frame'):
            self.selected = FrameChoice(
                gui, 'Frame', 'the frame whose details are shown; to select a frame, you can also '
                'click on its axes or in the tree')
            self.trail = FrameChoice(gui, 'Trail of', 'the frame whose recent path is drawn')
            self.follow = FrameChoice(
                gui, 'Follow', 'the frame that stays in the picture while it drives')
            self._follows_yaw = gui.add_checkbox(
                'Follow its yaw', False, hint='the scene turns with the frame')
            button = gui.add_button('Focus on the frame')
            button.on_click(partial(self._on_focus, 'frame'))
            self._details = gui.add_html('')
        self.tree = Tree(gui, tabs.add_tab('Tree'))
        with tabs.add_tab('Display'):
            self.display = DisplayPanel(gui, look_from)
        with tabs.add_tab('Pair'):
            self.pair = Pair(gui, feed.buffer, feed.time_text)
        with tabs.add_tab('By hand'):
            self.hand_frame = HandFrame(gui, client.scene, feed.hand_publisher)

    async def _on_reset(self, _: 'viser.GuiEvent[Any]') -> None:
        self._feed.reset()

    async def _on_focus(self, view: str, event: 'viser.GuiEvent[Any]') -> None:
        await self._look_from(view)

    @property
    def is_paused(self) -> bool:
        return self._pause is not None and bool(self._pause.value)

    async def _on_pause(self, event: 'viser.GuiEvent[Any]') -> None:
        self._back.value, self._back.disabled = 0.0, not event.target.value

    @property
    def back(self) -> float:
        """How far back a paused page looks (s)."""
        return within(self._back.value, 0.0, LENGTH) if self.is_paused else 0.0

    def set_frames(self, placement: Placement, names: list[str], now: float) -> None:
        """
        Set the dropdowns and the checkbox 'Show names'.

        Until the viewer uses the checkbox, it is ticked if there are at most `MOST_NAMES`
        frames.
        """
        if names != self._options and now >= self._next_options:
            self._options, self._next_options = names, now + len(names) * _OPTION_PERIOD
            for choice in self.fixed, self.trail, self.selected, self.follow:
                choice.set_options(names)
            self.follow.propose(self._feed.follow)
            self.pair.set_frames(names)
            self.hand_frame.set_frames(names)
        self.fixed.propose(placement.fixed)
        # While the first dynamic frames appear, the proposal follows the deepest one; then it
        # stays.
        if self._settled is None and placement.is_moving:
            self._settled = now + SETTLING
        if now <= (self._settled or now) or self._proposal not in placement.names:
            self._proposal = placement.deepest
        for choice in self.trail, self.selected:
            choice.propose(self._proposal)
        self.display.show_names(len(placement.names) <= MOST_NAMES)

    @property
    def follows_yaw(self) -> bool:
        """Whether the scene turns with the frame that it follows."""
        return bool(self._follows_yaw.value)

    @property
    def body(self) -> BodyDisplay:
        """What is drawn of the bodies of robots."""
        return self._robot.display if self._robot else BodyDisplay()

    def _add_robot_tab(self) -> None:
        tab = self._tabs.add_tab('Robot')
        with tab:
            self._robot = RobotPanel(self._gui)
        if self._joint_controls:
            self._joints = Joints(self._gui, tab, self._joint_controls)

    def act(self) -> None:
        """Move the joints as the viewer wants."""
        if self._joints:
            self._joints.act()

    def update_robots(self, lines: tuple[Sequence[str], Sequence[str]], now: float) -> None:
        """Show lines about the descriptions of robots, and the sliders of their joints."""
        if lines[0] and self._robot is None:
            self._add_robot_tab()
        if self._robot:
            self._robot.show(lines)
        if self._joints:
            self._joints.update(now)

    def show_texts(self, overview: str, details: str) -> None:
        """Show two texts in HTML."""
        self._overview.content, self._details.content = overview, details
