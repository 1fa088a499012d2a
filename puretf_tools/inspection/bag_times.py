"""The begin and the end of a bag, and times relative to them."""

from collections.abc import Iterable

from puretf import exact_time, Frame, SECOND

#: Stamps that differ this much (ns) from the median are outliers.
_FAR = 24 * 3600 * SECOND
#: So are those that are this much (ns) before or after the recording, if no more than half are.
_NEAR = 60 * SECOND


def span_of(frames: Iterable[Frame], recorded: tuple[int, int] = (0, 0)) -> tuple[int, int]:
    """
    Return the first and the last stamp (ns) of the dynamic frames of a bag, (1, 1) without one.

    The stamps of a node that publishes before its clock is set, or with another clock, can be
    wrong by years: they do not count.

    :param recorded: when the first and the last message were recorded (ns); (0, 0): not known.
    """
    frames = [frame for frame in frames if not frame.is_static and frame.oldest > 0]
    begin = min(_without_outliers([frame.oldest for frame in frames], *recorded))
    return begin, max(begin, *_without_outliers([frame.latest for frame in frames], *recorded))


def _without_outliers(stamps: list[int], begin: int, end: int) -> list[int]:
    near = [stamp for stamp in stamps if end and begin - _NEAR < stamp < end + _NEAR]
    if near and 2 * len(near) >= len(stamps):
        return near
    median = sorted(stamps)[len(stamps) // 2] if stamps else 0
    return [stamp for stamp in stamps if abs(stamp - median) < _FAR] or [1]


def why_outside(time: int, span: tuple[int, int]) -> str:
    """Return why a time (ns) is not in a bag; '' if it is, or means the latest time."""
    begin, end = span
    return '' if not time or begin <= time <= end else (
        f'{both(time, begin)} is outside of the bag, whose transforms are from '
        f'{exact_time(begin)} to {both(end, begin)}'
        + is_offset(time, span) * '; for seconds after its start, write + before them')


def is_offset(time: int, span: tuple[int, int]) -> bool:
    """Return whether a time before a bag (ns) can be meant as one after its start."""
    return 0 < time < span[0] and time <= span[1] - span[0]


def both(time: int, begin: int) -> str:
    """
    Write a time (ns) of a bag that begins at `begin`, as seconds after it and as a stamp.

    Of an earlier time, only the stamp is written, since -1 is a second before the end in options.

    >>> both(1760000012340000000, 1760000000000000000)
    '+12.34 s, 1760000012.340000000'
    """
    after = exact_time(time - begin).rstrip('0').rstrip('.')
    return f'+{after} s, {exact_time(time)}' if time >= begin else exact_time(time)
