"""
Error texts and log lines: tf2's own words, the hints that follow them, and printable names.

Names of frames are received from other nodes. They can contain any character, and can be long.
Therefore they are escaped and abbreviated before they are printed.
"""

from collections import deque
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from functools import lru_cache
import logging
from math import inf
from time import monotonic

from dummy_arm.tf._core.times import display_time, SECOND

#: The name of the type TFMessage, in the ROS graph and in bags of rosbag2.
TF_MESSAGE = 'tf2_msgs/msg/TFMessage'
#: The longest name (characters) that a log line shows in full.
LONGEST = 100
#: The largest number of names that an error lists.
_MAX_SHOWN = 5
#: The largest number of names that are compared with an unknown name.
_MAX_COMPARED = 1000


def visible(text: str) -> str:
    r"""
    Escape each character that is not printable, as `repr` does.

    Such characters can do harm: a control character can move the cursor of a terminal, and a lone
    surrogate cannot be encoded in UTF-8.

    :param text: a text of one line; a line feed would be escaped, too.
    :returns: the printable text.

    >>> print(visible('tool\x1b[2J'))
    tool\x1b[2J
    """
    return text if text.isprintable() else ''.join(
        c if c.isprintable() else repr(c)[1:-1] for c in text)


def visible_lines(text: str) -> str:
    r"""
    Escape each line of a text as `visible` does.

    :param text: the text; its line feeds are not escaped.
    :returns: the escaped text.

    >>> print(visible_lines('one\ntwo\r'))
    one
    two\r
    """
    return '\n'.join(map(visible, text.split('\n')))


def abbreviated(text: str, longest: int = LONGEST) -> str:
    """
    Replace the middle of a text by three dots if the text is too long.

    :param text: the text.
    :param longest: the largest number of characters to return, at least 3.
    :returns: the shortened text, or the text itself if it is short enough.

    >>> abbreviated('left_front_wheel', 11)
    'left...heel'
    """
    if len(text) <= longest:
        return text
    kept = longest - 3
    return f'{text[:kept - kept // 2]}...{text[len(text) - kept // 2:]}'


def shortened(name: str) -> str:
    r"""
    Abbreviate a name if it is longer than `LONGEST`, and escape it.

    :param name: the name of a frame, node or topic.
    :returns: the printable name.

    >>> print(shortened('tool\n'))
    tool\n
    >>> len(shortened('x' * 3000))
    100
    """
    return visible(abbreviated(name))


def logged(name: str) -> str:
    """
    Abbreviate and escape a name as `shortened` does; append the original length of a long name.

    :param name: the name of a frame, node or topic.
    :returns: the printable name.

    >>> logged('arm')
    'arm'
    >>> logged('x' * 3000) == 'x' * 49 + '...' + 'x' * 48 + ' (3000 characters)'
    True
    """
    return shortened(name) + (f' ({len(name)} characters)' if len(name) > LONGEST else '')


@lru_cache(maxsize=8)  # A program that waits for a frame prints the same error many times.
def suggest_names(name: str, known: tuple[str, ...], what: str = 'frames') -> str:
    """
    Return a sentence with the known names that are most similar to an unknown name.

    :param name: the name that does not exist.
    :param known: all names that exist.
    :param what: a plural noun for the things that have the names, such as 'frames'.
    :returns: a sentence with up to five similar names. If no name is similar, the sentence has the
        first five known names instead; if there are no known names, the sentence says so.

    >>> suggest_names('base_lnik', ('map', 'base_link', 'base_scan'))
    "Nearest known: 'base_link', 'base_scan'."
    >>> suggest_names('tool', ('map', 'odom'))
    "Known frames: 'map', 'odom'."
    >>> suggest_names('tool', ())
    'No transform has been received yet.'
    >>> suggest_names('rate', (), 'parameters')
    'There are no parameters.'
    """
    if not known:
        return ('No transform has been received yet.' if what == 'frames' else
                f'There are no {what}.')
    matches = []
    if len(name) <= LONGEST:
        matches = get_close_matches(name, match_candidates(known), _MAX_SHOWN)
    if matches:
        return f'Nearest known: {", ".join(map(quoted, matches))}.'
    return f'Known {what}: {comma_list(known, _MAX_SHOWN, quoted)}.'


def match_candidates(known: Sequence[str]) -> list[str]:
    """
    Return those known names with which an unknown name is compared.

    These are the names of at most `LONGEST` characters among the first 1000 known names. A
    comparison with more names, or with longer names, would take seconds.

    :param known: all names that exist.
    :returns: the names to compare, in the same order.

    >>> match_candidates(['map', 'x' * 3000, 'odom'])
    ['map', 'odom']
    """
    return [name for name in known[:_MAX_COMPARED] if len(name) <= LONGEST]


def quoted(name: str) -> str:
    r"""
    Abbreviate a name, and add quotes and escape sequences as `repr` does.

    :param name: the name of a frame, node or topic.
    :returns: the quoted name.

    >>> print(quoted('tool\n'))
    'tool\n'
    """
    return repr(abbreviated(name))


def comma_list(texts: Sequence[str], shown: int, write: Callable[[str], str] = str) -> str:
    """
    Join the first texts with commas, and append the number of the remaining texts.

    :param texts: the texts.
    :param shown: the largest number of texts that are joined.
    :param write: a function that converts each text before it is joined.
    :returns: the joined texts.

    >>> comma_list(['a', 'b', 'c', 'd'], 2)
    'a, b and 2 more'
    >>> comma_list(['a', 'b'], 2, quoted)
    "'a', 'b'"
    """
    more = f' and {len(texts) - shown} more' if len(texts) > shown else ''
    return f'{", ".join(map(write, texts[:shown]))}{more}'


def namespace_path(namespace: str) -> str:
    """
    Return a namespace as the beginning of the name of a topic.

    :param namespace: the namespace, with or without slashes at its ends.
    :returns: the namespace with a slash at its beginning only; '' for none.

    >>> namespace_path('robot/'), namespace_path('/')
    ('/robot', '')
    """
    return ''.join(f'/{part}' for part in namespace.split('/') if part)


def full_name(namespace: str, name: str) -> str:
    """
    Return the full name of a node.

    :param namespace: the namespace of the node, which begins with a slash.
    :param name: the name of the node.
    :returns: the full name.

    >>> full_name('/', 'arm'), full_name('/robot', 'arm')
    ('/arm', '/robot/arm')
    """
    return f'{namespace.rstrip("/")}/{name}'


def roots_hint(target: str, target_root: str, source: str, source_root: str) -> str:
    """
    Return the hint for two frames that are in different trees.

    :param target: the target frame.
    :param target_root: the root of the tree that contains the target frame.
    :param source: the source frame.
    :param source_root: the root of the tree that contains the source frame.
    :returns: a sentence that begins with a space.
    """
    return (f' {quoted(target)} is in the tree with root {quoted(target_root)}, '
            f'{quoted(source)} in the tree with root {quoted(source_root)}.')


def extrapolation_words(count: int, oldest: int, latest: int, time: int) -> str:
    """
    Return the text of tf2's error for a lookup at a time at which a frame has no pose.

    :param count: the number of samples in the history of the frame.
    :param oldest: the stamp of the oldest sample (ns).
    :param latest: the stamp of the newest sample (ns).
    :param time: the requested time (ns).
    :returns: the beginning of tf2's sentence; an empty text if there are no samples, as in tf2.
    """
    if not count:
        return ''
    if count == 1:
        return (f'Lookup would require extrapolation at time {display_time(time)}, but only time '
                f'{display_time(latest)} is in the buffer')
    if time > latest:
        return ('Lookup would require extrapolation into the future.  Requested time '
                f'{display_time(time)} but the latest data is at time {display_time(latest)}')
    return ('Lookup would require extrapolation into the past.  Requested time '
            f'{display_time(time)} but the earliest data is at time {display_time(oldest)}')


def extrapolation_hint(frame: str, parent: str, oldest: int, latest: int, time: int) -> str:
    """
    Return the hint for an edge that has no data at the requested time.

    The hint names the edge. It also says how far the requested time is from the nearest sample.

    :param frame: the child frame of the edge.
    :param parent: the newest parent of the frame.
    :param oldest: the stamp of the oldest sample of the frame (ns).
    :param latest: the stamp of the newest sample of the frame (ns).
    :param time: the requested time (ns), before `oldest` or after `latest`.
    :returns: a sentence that begins with a space.
    """
    edge = f'{quoted(parent)} -> {quoted(frame)}'
    if time > latest:
        return f' The data of edge {edge} end {exact_seconds(time - latest)} before that time.'
    return f' The data of edge {edge} begin {exact_seconds(oldest - time)} after that time.'


def cleared_hint(frame: str) -> str:
    """
    Return the hint for a frame that has no parent because its history was cleared.

    :param frame: the frame.
    :returns: a sentence that begins with a space.
    """
    return f' No transform of {quoted(frame)} has been received since the buffer was cleared.'


def loop_hint(chain: Sequence[str]) -> str:
    """
    Return the hint for a chain of frames that is too long, usually because it ends in a loop.

    :param chain: the names of the frames; each frame is the parent of the frame before it.
    :returns: a sentence with the frames of the loop, from parent to child. If there is no loop,
        the sentence says so.
    """
    last = chain[-1]
    earlier = [i for i, frame in enumerate(chain[:-1]) if frame == last]
    if not earlier:
        return f'There is no loop, but a chain of more than {len(chain) - 1} edges.'
    return f'The loop: {" -> ".join(map(quoted, reversed(chain[earlier[-1]:])))}.'


def exact_seconds(duration: int) -> str:
    """
    Convert a duration to a text in seconds, without rounding.

    :param duration: duration (ns), not negative.
    :returns: the number with nine decimals, and the unit.

    >>> exact_seconds(1_500_000_000)
    '1.500000000 s'
    """
    return f'{duration // SECOND}.{duration % SECOND:09d} s'


class ThrottledLog:
    """
    A log that limits how often it warns of the same cause.

    Warnings are queued; `flush` writes them. Do not hold a lock while you call `flush`: a handler
    of the log may look up transforms, and so wait for the lock of a buffer.
    """

    def __init__(self) -> None:
        """Create a log without warnings."""
        #: The function that writes a warning; another function may be assigned.
        self.write: Callable[[str], None] = logging.getLogger('dummy_arm.tf').warning
        #: The earliest time at which the next warning of a cause may be queued (s, on the
        #: monotonic clock); the keys are the causes.
        self._next_times: dict[str, float] = {}
        self._queue: deque[str] = deque()

    def warn(self, *problems: str) -> None:
        """
        Queue each warning, but at most one warning of each cause per second.

        :param problems: the texts of the warnings; the cause of a warning is the first word of its
            text.
        """
        for problem in problems:
            self._warn(problem.partition(' ')[0], problem, 1.0)

    def warn_once(self, cause: str, problem: str) -> None:
        """
        Queue a warning if no warning of the same cause has been queued before.

        :param cause: a name for the cause; it must differ from all causes that `warn` uses.
        :param problem: the text of the warning.
        """
        self._warn(cause, problem, inf)

    def _warn(self, cause: str, problem: str, silence: float) -> None:
        if self.is_due(cause, silence):
            self._queue.append(problem)

    def is_due(self, cause: str, silence: float) -> bool:
        """
        Return whether a warning of a cause may be written now, and count it as written.

        :param cause: a name for the cause.
        :param silence: the time for which no further warning of this cause is due (s).
        :returns: True if the warning may be written.
        """
        now = monotonic()
        if now < self._next_times.get(cause, now):
            return False
        self._next_times[cause] = now + silence
        return True

    def flush(self) -> None:
        """Write the queued warnings."""
        while self._queue:
            self.write(self._queue.popleft())
