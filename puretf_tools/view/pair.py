"""The transform between two frames: in numbers, as texts to copy, and over time."""

from collections.abc import Callable, Iterable
from math import atan2, degrees, hypot
from typing import Any, Optional

import numpy as np
import viser

from puretf import SECOND, Transform
from puretf.rotations import euler_from_quaternion
from puretf_tools.inspection.gaps import AnyBuffer
from puretf_tools.view.axes_and_trail import poses_over_time, STEP
from puretf_tools.view.controls import change, copied, FrameChoice, html
from puretf_tools.view.details import command_line, numbers
from puretf_tools.view.feed import Feed
from puretf_tools.view.settings import Settings, SPANS

#: The largest number of points of a plot.
_MOST_POINTS = 2400
#: What the plots of a live page and of a bag show, of `SPANS`.
_LIVE, _BAG = ('20 s', '2 min'), ('20 s', 'whole bag')
#: The colours of the plots: those of the axes x, y, z in the scene.
_COLOURS = 'rgb(200, 0, 0)', 'rgb(0, 130, 0)', 'rgb(0, 40, 210)'


class Pair:
    """The transform between two frames that a viewer chooses: numbers, texts to copy, plots."""

    def __init__(self, gui: viser.GuiApi, settings: Settings, feed: Feed) -> None:
        self._feed = feed
        self.choices = [FrameChoice(gui, label, settings=settings) for label in 'AB']
        gui.add_button_group('Frames', ('swap',)).on_click(self._on_swap)
        self._numbers = gui.add_html('')
        self._span = settings.control(
            gui.add_dropdown('Plot over', _BAG if feed.player else _LIVE))
        self._plots = (_add_plot(gui, 'translation', ('x (m)', 'y (m)', 'z (m)')),
                       _add_plot(gui, 'rotation', ('roll (°)', 'pitch (°)', 'yaw (°)')))
        self._texts = gui.add_html('')
        self._plotted: tuple[object, ...] = ()  # the frames, the span, and the end of the plots
        self._zero = 0  # of the time in the plots (ns)
        self.shown: Optional[Transform] = None  #: the transform; None: there is none

    @property
    def frames(self) -> tuple[str, str]:
        """The two frames; '': it is not chosen."""
        a, b = self.choices
        return a.chosen, b.chosen

    def choose(self, a: str, b: str) -> None:
        for choice, name in zip(self.choices, (a, b)):
            choice.choose(name)

    async def _on_swap(self, _: Any) -> None:
        self.choose(*self.frames[::-1])

    def update(self, buffer: AnyBuffer, end: int) -> None:
        """Show the transform at a time (ns; 0: the latest), and its values over time."""
        a, b = self.frames
        for choice in self.choices:
            choice.propose('')
        is_pair = a != b and '' not in (a, b)
        why, self.shown = _look_up(buffer, a, b, end) if is_pair else (
            'A and B are the same frame.' if a == b != '' else '', None)
        change(self._numbers, content=_as_table(self.shown, self._feed.time_text)
               if self.shown else html(why, 'pair'))
        change(self._texts, content=_as_texts(self.shown) if self.shown else '')
        last = end if is_pair and end else self.shown.stamp if self.shown else None
        plotted = a, b, self._span.value, last
        if plotted != self._plotted:
            self._plotted = plotted
            self._show_plots(buffer, last)

    def time_at(self, seconds: float) -> int:
        return self._zero + round(seconds * SECOND)

    def _show_plots(self, buffer: AnyBuffer, end: Optional[int]) -> None:
        """Show the values up to `end` (ns); hide the plots if there are none."""
        values, player = np.empty((0, 6)), self._feed.player
        if end is not None:
            seconds = SPANS[self._span.value]
            end = end or SECOND * max(1, seconds)  # both frames are static: at any time
            begin = max(1, end - seconds * SECOND)  # 0 would be the latest time
            if player and not seconds:
                begin, end = player.begin, player.end
            times, poses = poses_over_time(
                buffer, *self.frames, begin, end, max(STEP, (end - begin) // _MOST_POINTS))
            known = np.isfinite(poses).all(axis=1)
            times, values = times[known], np.array([
                (*pose[:3], *np.degrees(euler_from_quaternion(pose[3:]))) for pose in poses[known]
                ]).reshape(-1, 6)
            self._zero = player.begin if player else end
        is_visible = len(values) > 0
        for plot, columns in zip(self._plots, (values[:, :3], values[:, 3:])):
            if is_visible:
                plot.data = ((times - self._zero) / SECOND, *columns.T)
            plot.visible = is_visible
        self._span.visible = end is not None


def _look_up(buffer: AnyBuffer, a: str, b: str, end: int) -> tuple[str, Optional[Transform]]:
    """Return why there is no transform, or '' and the transform."""
    with buffer.updated():
        if why := buffer.why_not(a, b, end):
            return why, None
        if not end:
            latest = buffer.get_latest_common_time(a, b)
            end = latest if isinstance(latest, int) else latest.nanoseconds
        translations, rotations, _ = buffer.lookup_transforms(a, b, [end])
    return '', Transform(
        int(end), a, b, (*translations[0].tolist(),), (*rotations[0].tolist(),))


def _add_plot(gui: viser.GuiApi, title: str, labels: Iterable[str]) -> viser.GuiUplotHandle:
    """
    Add a hidden plot of three values over time.

    The values are drawn as dots. A line would cross the times without a transform, which are left
    out, since uPlot draws nothing if a value is NaN; and it would jump where an angle passes 180°.
    """
    series = [{'label': label, 'stroke': colour, 'width': 0, 'points': {
        'show': True, 'size': 2, 'space': 0, 'width': 1, 'stroke': colour, 'fill': colour}}
        for label, colour in zip(labels, _COLOURS)]
    return gui.add_uplot(
        (np.arange(2.0), *np.full((3, 2), np.nan)), ({'label': 'time (s)'}, *series),
        title=title, scales={'x': {'time': False}}, aspect=1.6, visible=False)


def _as_table(transform: Transform, time_text: Callable[[int], str]) -> str:
    stamp, *_, translation, rotation = transform
    angles = euler_from_quaternion(rotation)
    time = time_text(stamp) if stamp else 'all times'
    first, *others = transform.matrix().tolist()
    angle = 2.0 * atan2(hypot(*rotation[:3]), abs(rotation[3]))
    rows = ''.join(numbers('pair', *row) for row in (
        ('translation (m)', translation, 3), ('quaternion', rotation, 4),
        ('distance (m)', [hypot(*translation)], 3), ('angle (°)', [degrees(angle)], 2),
        ('RPY (°)', map(degrees, angles), 2), ('RPY (rad)', angles, 4),
        ('matrix', first, 3), *(('', row, 3) for row in others)))
    return (f'<table class="tf-details" data-text="pair">'
            f'<tr><td>time</td><td colspan="4">{time}</td></tr>{rows}</table>')


def _as_texts(transform: Transform) -> str:
    """Return in HTML a command, with nine digits, and a line of Python with all digits."""
    _, a, b, translation, rotation = transform
    if not np.isfinite(translation).all():
        return html('The translation is not finite.', 'copy')
    texts = [f'from puretf import Transform; transform = {transform!r}']
    if (a + b).isprintable():  # other characters could control the terminal
        texts.insert(0, command_line(a, b, zip(
            ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw'), (*translation, *rotation))))
    return ''.join(copied(text, 'copy') for text in texts)
