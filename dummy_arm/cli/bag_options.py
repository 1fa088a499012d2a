"""The command-line options for reading transforms from a bag."""

from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Optional

from dummy_arm.cli.parser import add_namespace_option, CommandError, UsageError
from dummy_arm.cli.progress import progress
from dummy_arm.cli.signals import check_signals
from dummy_arm.tf import BufferCore
from dummy_arm.tf.bag import BagError, read


def add_bag_options(parser: ArgumentParser) -> None:
    """
    Add the options `--bag`, `--namespace` and `--partial` to a parser.

    :param parser: the parser of the command.
    """
    parser.add_argument('--bag', metavar='FILE', help='read the transforms from a bag, '
                        'without ROS: a rosbag2 directory, a .mcap or .db3 file, or a .bag of '
                        'ROS 1')
    add_namespace_option(parser, 'read the transforms from')
    parser.add_argument('--partial', action='store_true',
                        help='with --bag: if the bag is cut off or damaged, read what can be read')


def read_bag(bag: Optional[str], namespace: str, partial: bool) -> Optional[BufferCore]:
    """
    Read the bag of the option `--bag`; if stderr is a terminal, show a progress bar.

    :param bag: path of the bag; None: no bag was given.
    :param namespace: namespace of the topics `tf` and `tf_static`. If it is '', the topics are
        `/tf` and `/tf_static`.
    :param partial: what to do if the bag is cut off or damaged. True: read its undamaged parts.
        False: raise a CommandError.
    :returns: a buffer with the transforms of the bag; None if no bag was given.
    :raises UsageError: if the path is empty, or if `partial` is set without a bag.
    :raises CommandError: if the bag cannot be read.
    :raises KeyboardInterrupt: if Ctrl-C or SIGTERM was received; see `dummy_arm.cli.signals`.
    """
    check_partial(bag, partial)
    if bag is None:
        return None
    with bag_progress(bag) as on_progress:
        return read(bag, namespace=namespace, partial=partial, on_progress=on_progress)


def check_partial(bag: Optional[str], partial: bool) -> None:
    """
    Check that the option `--partial` is given with a bag only.

    :param bag: path of the bag; None: no bag was given.
    :param partial: True if the option was given.
    :raises UsageError: if `partial` is set without a bag.
    """
    if partial and bag is None:
        raise UsageError('--partial needs --bag')


@contextmanager
def bag_progress(bag: str) -> Iterator[Callable[[float], object]]:
    """
    Read a bag in the `with` block; if stderr is a terminal, show a progress bar.

    :param bag: path of the bag.
    :returns: a context manager. The target of `as` is the argument `on_progress` for
        `dummy_arm.tf.bag`; it raises KeyboardInterrupt if Ctrl-C or SIGTERM was received.
    :raises UsageError: if the path is empty.
    :raises CommandError: if the block raises a BagError or an OSError.
    """
    if not bag:
        raise UsageError('--bag needs the path of a bag, got an empty one')

    def on_progress(done: float) -> None:
        """
        Move the bar.

        :param done: the fraction of the bag that has been read, from 0 to 1.
        :raises KeyboardInterrupt: if Ctrl-C or SIGTERM was received.
        """
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
