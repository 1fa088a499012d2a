"""The command-line options for reading transforms from a bag."""

from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Optional

from dummy_arm.cli.parser import add_namespace_option, CommandError, UsageError
from dummy_arm.cli.progress import progress
from dummy_arm.cli.signals import check_signals
from dummy_arm.tf import TransformBuffer
from dummy_arm.tf.bag import BagError, read


def add_bag_options(parser: ArgumentParser) -> None:
    parser.add_argument('--bag', metavar='FILE', help='read the transforms from a bag, '
                        'without ROS: a rosbag2 directory, a .mcap or .db3 file, or a .bag of '
                        'ROS 1')
    add_namespace_option(parser, 'read the transforms from')
    parser.add_argument('--partial', action='store_true',
                        help='with --bag: if the bag is cut off or damaged, read what can be read')


def read_bag(bag: Optional[str], namespace: str, partial: bool) -> Optional[TransformBuffer]:
    """
    Read the bag of the option `--bag`, with a bar; return None if the option is not given.

    :raises CommandError: if the bag cannot be read, or is damaged and `partial` is not set.
    """
    check_partial(bag, partial)
    if bag is None:
        return None
    with bag_progress(bag) as on_progress:
        return read(bag, namespace=namespace, partial=partial, on_progress=on_progress)


def check_partial(bag: Optional[str], partial: bool) -> None:
    if partial and bag is None:
        raise UsageError('--partial needs --bag')


@contextmanager
def bag_progress(bag: str) -> Iterator[Callable[[float], object]]:
    """
    Show a bar while the `with` block reads a bag, whose errors become CommandErrors.

    The target of `as` is the argument `on_progress` for `dummy_arm.tf.bag`; a signal ends it.
    """
    if not bag:
        raise UsageError('--bag needs the path of a bag, got an empty one')

    def on_progress(done: float) -> None:
        check_signals()
        show_progress(done)

    try:
        with progress(1.0, desc=f'reading {Path(bag).name}',
                      bar_format='{desc} {bar} {percentage:.0f} %') as show_progress:
            yield on_progress
    except BagError as error:
        raise CommandError(str(error)) from None
    except OSError as error:
        raise CommandError(f'cannot read {bag}: {error.strerror or error}') from None
