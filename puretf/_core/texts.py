"""Error texts and log lines: tf2's own words, and the warnings of this package."""

from collections import deque
from collections.abc import Callable, Sequence
import logging
from math import isnan
from time import monotonic

from puretf._text.names import abbreviated, visible
from puretf._text.times import cache_text, display_time

#: The largest number of warnings that are remembered, and of those that wait.
_MAX_WARNED, _MAX_QUEUED = 1000, 20
_LOGGER = logging.getLogger('puretf')

# The texts of tf2, unchanged.

UNKNOWN_FRAME = 'frame does not exist'
EMPTY_NAME = 'in tf2 frame_ids cannot be empty'
LEADING_SLASH = "in tf2 frame_ids cannot start with a '/'"


def extrapolation(count: int, oldest: int, latest: int, time: int, target: str, source: str
                  ) -> str:
    """Return the text for a time (ns) outside of `count` samples from `oldest` to `latest`."""
    words = ''
    if count == 1:
        words = (f'Lookup would require extrapolation at time {display_time(time)}, but only time '
                 f'{display_time(latest)} is in the buffer')
    elif count:
        to, bound, limit = ('future', 'latest', latest) if time > latest else (
            'past', 'earliest', oldest)
        words = (f'Lookup would require extrapolation into the {to}.  Requested time '
                 f'{display_time(time)} but the {bound} data is at time {display_time(limit)}')
    return f'{words}, when looking up transform from frame [{source}] to frame [{target}].'


def _plain(name: str) -> str:
    """Abbreviate and escape a name that stands in quotes already."""
    return visible(abbreviated(name))


def _of(child: str, authority: str) -> str:
    return f'child_frame_id "{_plain(child)}" from authority "{_plain(authority)}"'


def refusals(parent: str, child: str, pose: Sequence[float], authority: str, is_zero: bool
             ) -> list[tuple[str, str]]:
    """
    Return the codes of why tf2 refuses a transform, each with tf2's warning.

    :param pose: with the normalised rotation, which is NaN if it `is_zero`.
    """
    publisher = f'authority "{_plain(authority)}"'
    numbers = '({:f} {:f} {:f}) ({:f} {:f} {:f} {:f})'.format(*pose)
    numbers += ': its quaternion is zero' * is_zero
    reason = 'unnormalized' if is_zero else 'not_a_number'
    return [(code, text) for code, applies, text in (
        ('loop' if child else 'empty_name', parent == child,
         f'TF_SELF_TRANSFORM: Ignoring transform from {publisher} with frame_id and  '
         f'child_frame_id "{_plain(child)}" because they are the same'),
        ('empty_name', not child, f'TF_NO_CHILD_FRAME_ID: Ignoring transform from {publisher} '
         'because child_frame_id not set '),
        ('empty_name', not parent, 'TF_NO_FRAME_ID: Ignoring transform with child_frame_id '
         f'"{_plain(child)}"  from {publisher} because frame_id not set'),
        (reason, any(map(isnan, pose)), 'TF_NAN_INPUT: Ignoring transform for '
         f'{_of(child, authority)} because of a nan value in the transform {numbers}'),
        (reason, any(map(isnan, pose[3:])), 'TF_DENORMALIZED_QUATERNION: Ignoring transform for '
         f'{_of(child, authority)} because of an invalid quaternion in the transform '
         f'{numbers.partition(") ")[2]}')) if applies]


def old_data(child: str, stamp: int, authority: str, latest: int, cache_time: int) -> str:
    """Return tf2's warning about a transform that is too old, and the cause; times in ns."""
    return (f'TF_OLD_DATA ignoring data from the past for frame {_plain(child)} at time '
            f'{display_time(stamp)} according to authority {_plain(authority)}\n'
            f'It is {display_time(latest - stamp)} s older than the newest transform of this '
            f'frame, and {cache_text(cache_time)} are kept. This is logged once per frame')


# The warnings of this package, in the style of tf2's.


def too_many_frames(child: str, limit: int, authority: str) -> str:
    return (f'TF_TOO_MANY_FRAMES: Ignoring transform for {_of(child, authority)} because '
            f'max_frames of the buffer allows {limit} frames. All other transforms with a new '
            'frame are ignored, too')


def too_long_name(child: str, what: str, name: str, longest: int, authority: str) -> str:
    size = len(name.encode('utf-8', 'surrogatepass'))
    return (f'TF_LONG_FRAME_ID: Ignoring transform for {_of(child, authority)} because its {what} '
            f'has {size} bytes; at most {longest} are allowed')


def too_many_samples(child: str, authority: str, of_frame: int, of_buffer: int) -> str:
    return ('TF_TOO_MANY_SAMPLES: Dropping the oldest transforms of '
            f'{_of(child, authority)} before the cache time is over: at most {of_frame} are kept '
            f'of one frame with this cache time, and max_samples allows {of_buffer} in all. Those '
            'of other frames are dropped, too, if they are too many')


def expired(child: str, lost: int, total: int, is_full: bool, cache_time: int, longer: str) -> str:
    why = ('the buffer is full. Create it with max_samples=None, which has no limit'
           if is_full else 'they are older than the newest one by more than cache_time, '
           f'{cache_text(cache_time)}. Create the buffer with {longer}, or '
           'TransformBuffer(cache_time=None), which keeps all')
    return (f'TF_EXPIRED: Of {total} transforms for child_frame_id "{_plain(child)}" in one call, '
            f'{lost} are not kept: {why}. This is logged once per frame')


class ThrottledLog:
    """
    A log that warns of the same cause at most once a second.

    Warnings are queued; `flush` writes those that are due. Do not hold a lock while you call
    `flush`: a handler of the log may look up transforms, and so wait for the lock of a buffer.
    """

    def __init__(self, write: Callable[[str], object] = _LOGGER.warning) -> None:
        self.write = write  #: writes a warning; another function may be assigned
        #: The earliest monotonic time (s) of the next warning, by cause.
        self._next_times: dict[str, float] = {}
        #: The causes of warnings, each with what it was about.
        self._warned: set[tuple[str, str]] = set()
        #: Each cause and text, with a function that returns the end of the text.
        self._queue: deque[tuple[str, str, Callable[[], str]]] = deque()

    def warn(self, cause: str, text: str, about: str = '', end: Callable[[], str] = str) -> None:
        """
        Queue a warning, unless there was one of this cause about the same, such as a frame.

        `flush` calls `end`, which returns the end of the text.
        """
        warning = cause, abbreviated(about)
        if warning not in self._warned and len(self._queue) < _MAX_QUEUED:
            if len(self._warned) >= _MAX_WARNED:
                self._warned.clear()
            self._warned.add(warning)
            self._queue.append((cause, text, end))

    def forget(self) -> None:
        """Let `warn` warn of everything again."""
        self._warned.clear()

    def is_due(self, cause: str, silence: float = 1.0) -> bool:
        """Return whether a warning may be written; if so, the next is due after `silence` (s)."""
        now = monotonic()
        if now < self._next_times.get(cause, now):
            return False
        self._next_times[cause] = now + silence
        return True

    def flush(self, silence: float = 1.0) -> None:
        for _ in range(len(self._queue)):
            try:
                cause, text, end = self._queue.popleft()
            except IndexError:  # another thread has written it
                return
            if self.is_due(cause, silence):
                self.write(text + end())
            else:
                self._queue.append((cause, text, end))
