"""Frame names that are asked for: tf2's errors, and the nearest names that there are."""

from collections.abc import Callable
from typing import Optional

from dummy_arm.tf import hints
from dummy_arm.tf.exceptions import (
    InvalidArgumentException,
    LookupException,
    TransformException,
)
from dummy_arm.tf.frame_tree import FrameTree

_UNKNOWN = 'frame does not exist'


def check(name: str, where: str, tree: FrameTree) -> None:
    """
    Check that a frame exists.

    :param where: which argument of what it is, in tf2's words.
    :param tree: the frames that exist.
    :raises InvalidArgumentException: when it is empty or begins with a slash.
    :raises LookupException: when it does not exist.
    """
    problem = _problem(name, tree)
    if problem == _UNKNOWN:
        raise LookupException.hinting(
            f'"{name}" passed to {where} does not exist. ', _nearest(name, tree))
    if problem:
        raise InvalidArgumentException(f'Invalid argument "{name}" passed to {where} - {problem}')


def check_for_lookup(tree: FrameTree, **frames: str) -> None:
    """Check the frames of a lookup, each under the name of its argument, as `check` does."""
    for argument, name in frames.items():
        check(name, f'lookupTransform argument {argument}', tree)


def check_for_can(tree: FrameTree, **frames: str) -> None:
    """
    Check frames as `check_for_lookup` does, with what tf2's can_transform says.

    :raises TransformException: when one does not exist.
    """
    for argument, name in frames.items():
        if problem := _problem(name, tree):
            words = (f'Invalid frame ID "{name}" passed to canTransform argument {argument} - '
                     f'{problem}')
            if problem != _UNKNOWN:
                raise TransformException(words)
            raise TransformException.hinting(f'{words}. ', _nearest(name, tree))


def _nearest(name: str, tree: FrameTree) -> Callable[[], str]:
    """Return a function that finds the nearest of the names that are known now."""
    names = tree.names
    return lambda: hints.nearest(name, names)


def _problem(name: str, tree: FrameTree) -> Optional[str]:
    if not isinstance(name, str):
        raise TypeError(f'a frame must be a str, got {name!r} of type {type(name).__name__}')
    if not name:
        return 'in tf2 frame_ids cannot be empty'
    if name.startswith('/'):
        return "in tf2 frame_ids cannot start with a '/'"
    return None if name in tree.histories else _UNKNOWN
