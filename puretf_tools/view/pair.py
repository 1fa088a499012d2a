"""The transform between two frames: in numbers, as texts to copy, and over the last seconds."""

from collections.abc import Callable, Iterable, Sequence
from math import degrees
from typing import Any, Optional

import numpy as np
import viser

from puretf import SECOND, Transform
from puretf.rotations import euler_from_quaternion
from puretf_tools.inspection.terminal import fixed_point
from puretf_tools.view.controls import FrameChoice
from puretf_tools.view.details import command_line, copied, html, STYLE
from puretf_tools.view.feed import AnyBuffer, LENGTH

#: The shortest times between two updates of the numbers and of the plots (s).
_NUMBERS_PERIOD, _PLOTS_PERIOD = 0.2, 0.5
#: The times of the points of a plot, relative to the time shown (ns).
_OFFSETS = np.arange(-LENGTH * SECOND, 1, SECOND // 20, dtype=np.int64)
#: The colours of the plots: those of the axes x, y, z in the scene.
_COLOURS = 'rgb(200, 0, 0)', 'rgb(0, 130, 0)', 'rgb(0, 40, 210)'


class Pair:
    """The transform between two frames that a viewer chooses: numbers, texts to copy, plots."""

    def __init__(self, gui: viser.GuiApi, buffer: AnyBuffer, time_text: Callable[[int], str]
                 ) -> None:
        self.buffer, self._time_text = buffer, time_text
        self._a = FrameChoice(gui, 'A', 'the target frame, in which the pose of B is shown')
        self._b = FrameChoice(gui, 'B', 'the source frame, whose pose is shown')
        self._numbers = gui.add_html('')
        self._button = gui.add_button(
            'Write as text', visible=False,
            hint='a command and a line of Python that stay unchanged, so that you can copy them')
        self._button.on_click(self._on_click)
        self._texts = gui.add_html('')
        self._plots = (_add_plot(gui, 'translation (m)', ('x', 'y', 'z')),
                       _add_plot(gui, 'rotation (°)', ('roll', 'pitch', 'yaw')))
        self._frames = '', ''
        self._shown: Optional[Transform] = None
        #: The `end` and the `now` of the last update of the numbers and of the plots.
        self._updates: dict[str, tuple[int, float]] = {}

    async def _on_click(self, _: 'viser.GuiEvent[Any]') -> None:
        if transform := self._shown:
            self._texts.content = _as_texts(transform)

    def set_frames(self, names: Sequence[str]) -> None:
        """Set the frames that can be chosen."""
        for choice in self._a, self._b:
            choice.set_options(names)
            choice.propose('')

    def update(self, end: int, now: float) -> None:
        """
        Show the transform, and its values in the `LENGTH` seconds before.

        :param end: the time of the transform (ns); 0: the latest one that the pair has. If it is
            the same as before, nothing changes, even if the buffer has dropped the data.
        :param now: the time on the monotonic clock (s).
        """
        a, b = frames = self._a.chosen, self._b.chosen
        if frames != self._frames:
            self._frames, self._texts.content = frames, ''
            self._updates.clear()
        if '' in frames or a == b:
            self._show_numbers('A and B are the same frame.' if a == b != '' else '', None)
            self._show_plots(None)
            return
        if self._is_due('numbers', _NUMBERS_PERIOD, end, now):
            self._show_numbers(*self._look_up(a, b, end))
        if self._is_due('plots', _PLOTS_PERIOD, end, now):
            self._show_plots(end or (self._shown.stamp if self._shown else None))

    def _is_due(self, part: str, period: float, end: int, now: float) -> bool:
        """Return True, and note the update, if a part must be updated now."""
        last_end, last = self._updates.get(part, (0, -np.inf))
        if now < last + period or end == last_end != 0:
            return False
        self._updates[part] = end, now
        return True

    def _look_up(self, a: str, b: str, end: int) -> tuple[str, Optional[Transform]]:
        """Return why there is no transform, or '' and the transform."""
        with self.buffer.updated():
            if why := self.buffer.why_not(a, b, end):
                return why, None
            if not end:
                latest = self.buffer.get_latest_common_time(a, b)
                end = latest if isinstance(latest, int) else latest.nanoseconds
            translations, rotations, _ = self.buffer.lookup_transforms(a, b, [end])
        return '', Transform(
            int(end), a, b, (*translations[0].tolist(),), (*rotations[0].tolist(),))

    def _show_numbers(self, why_not: str, transform: Optional[Transform]) -> None:
        self._shown = transform
        self._numbers.content = (
            _as_table(transform, self._time_text) if transform else html(why_not, 'pair'))
        self._button.visible = transform is not None

    def _show_plots(self, end: Optional[int]) -> None:
        """Show the values in the time before `end` (ns); hide the plots if there are none."""
        known = np.zeros(0, np.bool_)
        if end is not None:
            times = np.maximum(end + _OFFSETS, 1)  # 0 would be the latest time
            translations, rotations, known = self.buffer.lookup_transforms(*self._frames, times)
        is_visible = bool(known.any())
        if is_visible:
            angles = np.full(translations.shape, np.nan)
            angles[known] = [*map(euler_from_quaternion, rotations[known].tolist())]
            translations[~np.isfinite(translations)] = np.nan
            for plot, values in zip(self._plots, (translations, np.degrees(angles))):
                plot.data = (_OFFSETS / SECOND, *values.T)
        for plot in self._plots:
            plot.visible = is_visible


def _add_plot(gui: viser.GuiApi, title: str, labels: Iterable[str]) -> viser.GuiUplotHandle:
    """
    Add a hidden plot of three values over time.

    The values are drawn as dots. A line of uPlot would cross the times without a transform, since
    it has gaps at null only, and viser sends NaN; and it would jump where an angle passes 180°.
    """
    series = [{'label': label, 'stroke': colour, 'width': 0, 'points': {
        'show': True, 'size': 2, 'space': 0, 'width': 1, 'stroke': colour, 'fill': colour}}
        for label, colour in zip(labels, _COLOURS)]
    return gui.add_uplot(
        (_OFFSETS / SECOND, *np.full((3, len(_OFFSETS)), np.nan)), ({'label': 's'}, *series),
        title=title, scales={'x': {'time': False}}, aspect=1.6, visible=False)


def _as_table(transform: Transform, time_text: Callable[[int], str]) -> str:
    """Return a transform in HTML, in numbers that are rounded."""
    stamp, *_, translation, rotation = transform
    angles = euler_from_quaternion(rotation)
    time = time_text(stamp) if stamp else 'all times'
    first, *others = transform.matrix().tolist()
    rows = ''.join((
        _row('translation (m)', translation, 3), _row('quaternion', rotation, 4),
        _row('RPY (°)', map(degrees, angles), 2), _row('RPY (rad)', angles, 4),
        _row('matrix', first, 3), *(_row('', row, 3) for row in others)))
    return (f'<table style="{STYLE}" data-text="pair">'
            f'<tr>{_label("time")}<td colspan="4">{time}</td></tr>{rows}</table>')


def _as_texts(transform: Transform) -> str:
    """Return in HTML a command, with nine digits, and a line of Python with all digits."""
    _, a, b, translation, rotation = transform
    if not np.isfinite(translation).all():
        return html('The translation is not finite.', 'pair')
    texts = [f'from puretf import Transform; transform = {transform!r}']
    if (a + b).isprintable():  # other characters could control the terminal
        texts.insert(0, command_line(a, b, zip(
            ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw'), (*translation, *rotation))))
    return html('Click a text to select it.', 'pair') + ''.join(
        copied(text, 'pair') for text in texts)


def _row(label: str, values: Iterable[float], precision: int) -> str:
    cells = ''.join('<td style="text-align: right; padding-left: .4em; overflow-wrap: normal">'
                    f'{fixed_point(value, precision)}</td>' for value in values)
    return f'<tr>{_label(label)}{cells}</tr>'


def _label(text: str) -> str:
    return f'<td style="opacity: .7">{text}</td>'
