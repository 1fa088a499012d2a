"""The command-line options for reading transforms from bags."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Optional

from puretf.bag import Bag, BagError, is_bag
from puretf.bag import open as open_bag
from puretf_tools.cli.parser import add_namespace_option, CommandError, Parser, UsageError
from puretf_tools.cli.progress import DEFAULT_TIME, listening_time, progress
from puretf_tools.cli.times import When

#: Remedies in Python, and the same for commands.
_REMEDIES = {'partial=True': '--partial', 'pass namespace=': 'pass --namespace',
             ': if this size is expected, pass a larger max_bytes to bag.read': ''}


class BagOption(NamedTuple):
    """The bag of the options `--bag`, `--namespace` and `--partial`."""

    paths: Sequence[str]
    namespace: str = ''
    is_partial: bool = False

    @contextmanager
    def opened(self, on_progress: Optional[Callable[[float], object]] = None) -> Iterator[Bag]:
        """
        Open the bag; its errors become CommandErrors.

        :param on_progress: see `puretf.bag.open`; None: show a bar while the bag is read.
        """
        with bag_progress(self.paths, on_progress) as show, open_bag(
                self.paths, partial=self.is_partial, namespace=self.namespace,
                on_progress=show) as bag:
            yield bag


def add_bag_options(parser: Parser, *listening: str) -> None:
    """
    Add options; the command gets a `BagOption`, or None, as the argument `bag`.

    :param listening: the names of the option for how long to listen without a bag: `seconds`.
    """
    parser.prepare, parser.finish = _repeat_option, partial(_join, listening)
    if listening:
        parser.add_argument(*listening, type=listening_time, dest='seconds', metavar='SECONDS',
                            help='how long to listen, from the first transform on (s; default: '
                                 f'{DEFAULT_TIME:g})')
    parser.add_argument('--bag', action='append', metavar='FILE...',
                        help='read the transforms from a bag, without ROS: a rosbag2 directory, a '
                        '.mcap or .db3 file, or a .bag of ROS 1. Of a recording that was split, '
                        'give the directory, or all files')
    add_namespace_option(parser, 'read the transforms from')
    parser.add_argument('--partial', action='store_true', help='with --bag: if a file is '
                        'missing, cut off or damaged, read what can be read')


def _repeat_option(arguments: Sequence[str]) -> list[str]:
    """
    Write `--bag` before each path that follows the path of `--bag`.

    A path is what exists as a bag or ends like one, so that the names of frames may follow.

    >>> _repeat_option(['--bag', 'a.mcap', 'b.mcap', 'map', 'tool'])
    ['--bag', 'a.mcap', '--bag', 'b.mcap', 'map', 'tool']
    """
    repeated: list[str] = []
    is_open = False
    for i, argument in enumerate(arguments):
        is_value = i > 0 and arguments[i - 1] == '--bag'
        if is_open and not is_value and not argument.startswith('-') and is_bag(argument):
            repeated.append('--bag')
        elif not is_value:
            is_open = argument == '--bag' or argument.startswith('--bag=')
        repeated.append(argument)
    return repeated


def _join(listening: Sequence[str], options: dict[str, Any]) -> None:
    """Join the options of a bag to one; check those that need a bag, or none."""
    paths, is_partial = options['bag'], options.pop('partial')
    if is_partial and paths is None:
        raise UsageError('--partial needs --bag')
    if not all(paths or ()):
        raise UsageError('--bag needs the path of a bag, got an empty one')
    if not paths and any(isinstance(each, When) and each.sign for each in options.values()):
        raise UsageError('a time with a sign counts from the start or the end of a bag: it needs '
                         '--bag')
    if listening:
        if paths and options['seconds'] is not None:
            raise UsageError(f'{" or ".join(listening)} is for listening: leave it out with --bag')
        options['seconds'] = options['seconds'] or DEFAULT_TIME
    options['bag'] = paths and BagOption(paths, options['namespace'], is_partial)


@contextmanager
def bag_progress(bag: Sequence[str], on_progress: Optional[Callable[[float], object]] = None
                 ) -> Iterator[Callable[[float], object]]:
    """
    Show a bar while the `with` block reads a bag, whose errors become CommandErrors.

    :param on_progress: what takes the place of the bar, if it is given.
    """
    try:
        with nullcontext(on_progress) if on_progress else progress(
                1.0, desc=f'reading {Path(bag[0]).name}',
                bar_format='{desc} {bar} {percentage:.0f} %') as show:
            yield show
    except BagError as error:
        raise CommandError(for_commands(str(error))) from None
    except OSError as error:
        raise CommandError(
            f'cannot read {error.filename or bag[0]}: {error.strerror or error}') from None


def for_commands(text: str) -> str:
    """Write the remedies of an error of a bag as options."""
    for in_python, option in _REMEDIES.items():
        text = text.replace(in_python, option)
    return text
