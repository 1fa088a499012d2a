"""The texts about frames: an overview, the details of one, and the command that publishes it."""

from collections.abc import Iterable
from math import degrees
from shlex import quote

from puretf._text.names import comma_list, visible
from puretf.rotations import euler_from_quaternion
from puretf_tools.inspection import traffic
from puretf_tools.inspection.gaps import AnyBuffer
from puretf_tools.inspection.terminal import fixed_point
from puretf_tools.view.controls import escaped, html
from puretf_tools.view.feed import Feed
from puretf_tools.view.placement import Floats, MAX_FRAMES, Placement, REACH

#: The heading of rows of numbers.
_XYZW = ('<tr class="tf-numbers" data-value=""><th></th><td>x</td><td>y</td><td>z</td><td>w</td>'
         '</tr>')


def overview(placement: Placement, feed: Feed, fixed: str = '') -> str:
    """Return in HTML which frames are not shown, and every other problem; '' if there is none."""
    names = placement.names
    count = len({*names, *placement.dead, *placement.left_out}.union(*placement.loops))
    lines = [f'{len(names)} of {count} frames'] if len(names) < count else [] if count else [
        f'no frames yet. {escaped(feed.why_no_frames())}']
    if count and feed.hint:
        lines.append(escaped(feed.hint))
    for what, is_shown in ('shown without a parent', True), ('not shown', False):
        if dead := [name for name in placement.dead if (name in names) == is_shown]:
            lines.append(f'{what}, because {_silence(placement)}: {_list(dead)}')
    if placement.left_out:
        lines.append(f'more than {MAX_FRAMES}, not shown: {_list(placement.left_out)}')
    if fixed not in ('', placement.fixed):
        lines.append(f'the fixed frame {escaped(fixed)} is not available' + (
            f'; instead of it: {escaped(placement.fixed)}' if placement.fixed else ''))
    if len(placement.trees) > 1:
        others = [name for name in placement.trees if name != placement.fixed]
        lines.append(f'not connected to {escaped(placement.fixed)}: {_list(others)}')
    if placement.far:
        lines.append(f'more than {REACH:,.0f} m away, not drawn: {_list(placement.far)}')
    lines += [f'in a loop: {" → ".join(map(escaped, [*loop, loop[0]]))}'
              for loop in placement.loops]
    return f'<div class="tf-text" data-text="overview">{"<br>".join(lines)}</div>' if lines else ''


def _silence(placement: Placement) -> str:
    return f'no transform with a newer stamp has arrived for {placement.timeout:g} s'


def _list(names: list[str]) -> str:
    return comma_list(names, escaped)


def details(placement: Placement, name: str, feed: Feed, buffer: AnyBuffer) -> str:
    """Return in HTML a table of one frame, or a sentence; `buffer`: that of the placement."""
    if name not in placement.names:
        why = f': {_silence(placement)}' if name in placement.dead else ''
        return html(f'{name} is not available{why}.' if name else 'Click a frame, or choose one.',
                    'details')
    i = placement.names.index(name)
    frame = placement.frames.get(name)
    target = placement.anchors[i]
    rows = ''
    if frame is None:
        rows += _title('parent', '', 'no parent: this is a root')
    else:
        rows += _title('parent', frame.parent, 'pose in the parent')
        translations, rotations, known = buffer.lookup_transforms(
            frame.parent, name, [frame.latest])
        if known[0]:  # the buffer may have dropped the sample since the placement
            rows += _pose('parent', feed, frame.latest, translations[0], rotations[0])
    if frame is None or frame.parent != target:
        rows += _title('fixed', target, 'pose in the fixed frame' if target == placement.fixed else
                       'pose in the root')
        rows += _pose('fixed', feed, placement.stamps[i], placement.poses[i, :3],
                      placement.poses[i, 3:])
    if hole := feed.hole(target, name):
        rows += _wide(f'<span data-value="hole">{escaped(hole)}</span>')
    if frame is not None:
        delay, publisher = feed.publication(frame)
        rows += _title('', '', 'published')
        rows += _row('rate', 'average rate', rate_text(placement, name))
        if not frame.is_static:
            rows += _row('delay', 'delay', 'not known' if delay is None else
                         f'{delay * 1e3:.2f} ms')
        rows += _row('publisher', 'publisher', publisher)
    if target != placement.fixed and (why := buffer.why_not(placement.fixed, name, 0)):
        rows += _wide(f'not in the fixed frame: <span data-value="why">{escaped(why)}</span>')
    return f'<table class="tf-details" data-text="details">{rows}</table>'


def rate_text(placement: Placement, name: str) -> str:
    frame = placement.frames.get(name)
    if name in placement.late:
        return f'silent for {placement.late[name]:.0f} s'
    return traffic.rate_text(frame) if frame else ''


def _pose(prefix: str, feed: Feed, stamp: int, translation: Floats, rotation: Floats) -> str:
    """Return the rows of a pose: time, position, quaternion, and roll, pitch, yaw."""
    when, full = (feed.ago(stamp), feed.time_text(stamp)) if stamp else ('all times', '')
    angles = [degrees(angle) for angle in euler_from_quaternion((*rotation.tolist(),))]
    return _row(f'{prefix}-time', 'time', when, full) + _XYZW + (
        numbers(f'{prefix}-translation', 'position (m)', translation.tolist(), 3)
        + numbers(f'{prefix}-quaternion', 'quaternion', rotation.tolist(), 4)
        + numbers(f'{prefix}-rpy', 'RPY (°)', angles, 2))


def _title(key: str, name: str, text: str) -> str:
    """Return a heading row: a text, then the name of a frame in bold; the name may be ''."""
    return _wide(f'{text} <b data-value="{key}">{escaped(name)}</b>')


def _wide(text: str) -> str:
    return f'<tr><td colspan="5">{text}</td></tr>'


def _row(key: str, label: str, value: str, title: str = '') -> str:
    return (f'<tr><td>{label}</td><td colspan="4" data-value="{key}" title="{escaped(title)}">'
            f'{escaped(value)}</td></tr>')


def numbers(key: str, label: str, values: Iterable[float], digits: int) -> str:
    cells = ''.join(f'<td>{fixed_point(value, digits)}</td>' for value in values)
    return f'<tr class="tf-numbers" data-value="{key}"><th>{label}</th>{cells}</tr>'


def command_line(parent: str, child: str, numbers: Iterable[tuple[str, float]]) -> str:
    """Return the command that publishes a transform; numbers: by option, such as x or yaw."""
    frames = ('frame-id', parent), ('child-frame-id', child)
    return ' '.join(['static_transform_publisher', *(
        f'--{option} {round(value, 9)}' for option, value in numbers if value), *(
        # The parser takes a value that begins with a hyphen only after '='.
        f'--{option}{"=" if frame.startswith("-") else " "}{quote(visible(frame))}'
        for option, frame in frames)])
