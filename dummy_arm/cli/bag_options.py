"""The options of commands that can take their transforms from a bag."""

from argparse import ArgumentParser
from pathlib import Path
from typing import Optional

from dummy_arm.cli.parser import CommandError, UsageError
from dummy_arm.cli.progress import progress
from dummy_arm.cli.signals import check_signals
from dummy_arm.tf import BufferCore
from dummy_arm.tf.bag import BagError, read


def add_bag_options(parser: ArgumentParser) -> None:
    """Let a command take a bag."""
    parser.add_argument('--bag', metavar='FILE', help='take the transforms from a bag: the '
                        'directory of rosbag2, a .mcap, a .db3, or a .bag of ROS 1; needs no ROS')
    parser.add_argument('--namespace', default='', metavar='NAME',
                        help='of a bag: take /NAME/tf and /NAME/tf_static')
    parser.add_argument('--partial', action='store_true',
                        help='of a bag that is cut off or damaged: take what can be read')


def read_bag(bag: Optional[str], namespace: str, partial: bool) -> Optional[BufferCore]:
    """
    Read a bag, if one is given; with a progress bar on a terminal.

    :raises UsageError: when none is, but one of its options; or it has no name.
    :raises CommandError: when it cannot be read.
    :raises KeyboardInterrupt: when a signal comes.
    """
    if bag is None:
        if namespace or partial:
            raise UsageError(
                '--namespace and --partial are about a bag; to listen in a namespace: '
                '--ros-args -r /tf:=/NAME/tf -r /tf_static:=/NAME/tf_static')
        return None
    if not bag:
        raise UsageError('a bag must have a name')

    def on_progress(done: float) -> None:
        check_signals()
        show(done)

    try:
        with progress(1.0, desc=f'reading {Path(bag).name}',
                      bar_format='{desc} {bar} {percentage:.0f} %') as show:
            return read(bag, namespace=namespace, partial=partial, on_progress=on_progress)
    except BagError as error:
        raise CommandError(str(error)) from None
    except OSError as error:
        raise CommandError(f'cannot read {bag}: {error.strerror}') from None
