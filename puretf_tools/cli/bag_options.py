"""The command-line options for reading transforms from bags."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Optional

from puretf import TransformBuffer
from puretf.bag import BagError, is_bag, read
from puretf_tools.cli.namespace_option import add_namespace_option
from puretf_tools.cli.parser import CommandError, Parser, UsageError
from puretf_tools.cli.progress import progress


def add_bag_options(parser: Parser) -> None:
    parser.prepare = _repeat_option
    parser.add_argument('--bag', action='append', metavar='FILE...',
                        help='read the transforms from a bag, without ROS: a rosbag2 directory, a '
                        '.mcap or .db3 file, or a .bag of ROS 1. Of a recording that was split, '
                        'give the directory, or all files')
    add_namespace_option(parser, 'read the transforms from')
    parser.add_argument('--partial', action='store_true', help='with --bag: if a .mcap file is '
                        'cut off or damaged, read what can be read')


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


def read_bag(bag: Optional[Sequence[str]], namespace: str, partial: bool
             ) -> Optional[TransformBuffer]:
    """
    Read the bag of the option `--bag`, with a bar; return None if the option is not given.

    :raises CommandError: if the bag cannot be read, or is damaged and `partial` is not set.
    """
    check_bag_options(bag, partial)
    if bag is None:
        return None
    with bag_progress(bag) as on_progress:
        return read(bag, namespace=namespace, partial=partial, on_progress=on_progress)


def check_bag_options(bag: Optional[Sequence[str]], partial: bool) -> None:
    if partial and bag is None:
        raise UsageError('--partial needs --bag')
    if not all(bag or ()):
        raise UsageError('--bag needs the path of a bag, got an empty one')


@contextmanager
def bag_progress(bag: Sequence[str]) -> Iterator[Callable[[float], object]]:
    """
    Show a bar while the `with` block reads a bag, whose errors become CommandErrors.

    The target of `as` is the argument `on_progress` for `puretf.bag`; a signal ends it.
    """
    try:
        with progress(1.0, desc=f'reading {Path(bag[0]).name}',
                      bar_format='{desc} {bar} {percentage:.0f} %') as on_progress:
            yield on_progress
    except BagError as error:
        raise CommandError(str(error)) from None
    except OSError as error:
        raise CommandError(
            f'cannot read {error.filename or bag[0]}: {error.strerror or error}') from None
