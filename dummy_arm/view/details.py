"""The texts of the panel, in HTML: about all frames, and about one."""

from collections.abc import Iterable
from html import escape
from math import degrees

import numpy as np
from numpy.typing import NDArray

from dummy_arm.inspection.terminal import fixed_point
from dummy_arm.tf import Frame
from dummy_arm.tf.formatting import comma_list, SECOND, visible
from dummy_arm.tf.rotations import euler_from_quaternion
from dummy_arm.view.rods import TIMEOUT
from dummy_arm.view.snapshot import REACH, Snapshot
from dummy_arm.view.source import Source

_SILENT = 1.0  # s
_MOST = 5  # names in a list
_STYLE = ('margin: 0 1em .5em; font-size: .85em; line-height: 1.5; '
          'font-variant-numeric: tabular-nums; overflow-wrap: anywhere')


def overview(snapshot: Snapshot, source: Source, fixed: str = '') -> str:
    """
    Tell how many frames there are, and what is wrong.

    :param fixed: in which they should be shown; '': in any.
    """
    gone = [name for name, age in zip(snapshot.names, snapshot.ages.tolist()) if age >= TIMEOUT]
    alive = len(snapshot.names) - len(gone)
    name = _text(source.name)
    lines = [f'{name}: {alive} frame{"" if alive == 1 else "s"}' if snapshot.names else
             f'{name}: nothing yet. {_text(source.why_no_frames())}']
    if gone:
        lines.append(f'not shown, since nothing was heard of them or on the way to them for '
                     f'{TIMEOUT:g} s: {comma_list(gone, _MOST, _text)}')
    if fixed not in ('', snapshot.fixed):
        lines.append(f'{_text(fixed)} is not there')
    if len(snapshot.trees) > 1:
        others = [name for name in snapshot.trees if name != snapshot.fixed]
        lines.append(f'not connected to {_text(snapshot.fixed)}: '
                     f'{comma_list(others, _MOST, _text)}')
    if far := [name for name in snapshot.far if name not in {*gone}]:
        lines.append(f'more than {REACH:,.0f} m away, drawn at that distance: '
                     f'{comma_list(far, _MOST, _text)}')
    if snapshot.not_finite:
        lines.append('not shown, since the translation is not finite: '
                     f'{comma_list(snapshot.not_finite, _MOST, _text)}')
    lines += [f'in a loop: {" → ".join(map(_text, [*loop, loop[0]]))}' for loop in snapshot.loops]
    return f'<div style="{_STYLE}" data-text="overview">{"<br>".join(lines)}</div>'


def details(snapshot: Snapshot, name: str, source: Source) -> str:
    """
    Tell where a frame is, and how it is published.

    :param name: of the frame; '' or not shown: there is nothing to tell.
    """
    if name not in snapshot.names:
        text = f'{_text(name)} is not there.' if name else 'Click a frame, or choose one.'
        return f'<div style="{_STYLE}" data-text="details">{text}</div>'
    i = snapshot.names.index(name)
    frame = snapshot.frames.get(name)
    target, _ = snapshot.anchor_of(name)
    rows = ''
    if frame is None:
        rows += _title('parent', '', 'no parent: a root')
    else:
        rows += _title('parent', frame.parent, 'in its parent')
        translations, rotations, known = source.buffer.lookup_transforms(
            frame.parent, name, [frame.latest])
        if known[0]:  # else it was forgotten since it was shown
            rows += _pose('parent', frame.latest, translations[0], rotations[0])
    if frame is None or frame.parent != target:
        rows += _title('fixed', target, 'in the fixed frame' if target == snapshot.fixed else 'in')
        rows += _pose('fixed', snapshot.stamps[i], snapshot.poses[i, :3], snapshot.poses[i, 3:])
    if frame is not None:
        rows += _published(frame, snapshot.silences[name], source)
    return f'<table style="{_STYLE}" data-text="details">{rows}</table>'


def _published(frame: Frame, silence: float, source: Source) -> str:
    """Tell how a frame is published."""
    publication = source.publication(frame)
    rows = _title('', '', 'published')
    if frame.is_static:
        rows += _row('rate', 'rate', 'static')
    else:
        rows += _row('rate', 'rate', f'silent for {silence:.0f} s' if silence > _SILENT else
                     'not known' if publication.rate is None else f'{publication.rate:.1f} Hz')
        rows += _row('delay', 'delay', 'not known' if publication.delay is None else
                     f'{publication.delay * 1e3:.2f} ms')
    return rows + _row('publisher', 'by', publication.publisher)


def _pose(where: str, stamp: int, translation: NDArray[np.float64],
          rotation: NDArray[np.float64]) -> str:
    """Write a pose; its rotation twice."""
    quaternion = (*rotation.tolist(),)
    angles = [degrees(angle) for angle in euler_from_quaternion(quaternion)]
    return ''.join((
        _row(f'{where}-time', 'at', f'{stamp // SECOND}.{stamp % SECOND:09d} s' if stamp else
             'all times'),
        _row(f'{where}-translation', 'x y z (m)', _numbers(translation.tolist(), 3)),
        _row(f'{where}-quaternion', 'quaternion', _numbers(quaternion, 4)),
        _row(f'{where}-rpy', 'RPY (°)', _numbers(angles, 2))))


def _title(key: str, name: str, text: str) -> str:
    """Write a row above others; a name after its text, if there is one."""
    return (f'<tr><td colspan="2" style="padding-top: .4em">{text} '
            f'<b data-value="{key}">{_text(name)}</b></td></tr>')


def _row(key: str, label: str, value: str) -> str:
    return (f'<tr><td style="padding-right: .8em; opacity: .7; white-space: nowrap">{label}</td>'
            f'<td data-value="{key}">{_text(value)}</td></tr>')


def _numbers(values: Iterable[float], precision: int) -> str:
    return '  '.join(fixed_point(value, precision) for value in values)


def _text(text: str) -> str:
    return escape(visible(text))
