"""Where all frames are in one of them, found by one walk through the tree."""

from collections.abc import Iterable
from typing import Optional

from dummy_arm.tf import frame_names
from dummy_arm.tf.buffer_core import BufferCore
from dummy_arm.tf.exceptions import TransformException
from dummy_arm.tf.frame_tree import FrameTree
from dummy_arm.tf.history import NoPose, Pose
from dummy_arm.tf.lookup import Lookups
from dummy_arm.tf.path import compose, IDENTITY, inverse, Path
from dummy_arm.tf.static_history import AnyHistory
from dummy_arm.tf.transform import Transform

#: An edge, at one of its ends: the frame at the other, whether that is the child, and the poses.
_Edge = tuple[str, bool, AnyHistory]


def place(buffer: BufferCore, target_frame: str, until: int = 0) -> dict[str, Transform]:
    """
    Look up every frame that is connected to a frame, at the latest time that all between know of.

    That is what a lookup of each would give, up to rounding. It takes a fraction of the time where
    the transforms on the way have their stamps in common.

    :param until: no later than this time (ns), by the parents that the frames have then; 0:
        without a limit.
    :returns: by the names of the frames, the nearest first; without those of which nothing is
        known at that time.
    :raises TransformException: when there is no such frame.
    """
    return place_in_each(buffer, [target_frame], until)[0]


def place_in_each(buffer: BufferCore, target_frames: Iterable[str], until: int = 0
                  ) -> list[dict[str, Transform]]:
    """Look up the frames that are connected to each of some frames; as `place`."""
    with buffer.fetched():
        edges = _edges(buffer._lookups.tree, until)
        return [_place(buffer._lookups, edges, target, until) for target in target_frames]


def _place(lookups: Lookups, edges: dict[str, list[_Edge]], target: str, until: int
           ) -> dict[str, Transform]:
    histories = lookups.tree.histories
    if target not in histories:
        frame_names.check(target, 'place', lookups.tree)
    own, placed = histories[target], _placed(lookups, edges, target, until)
    if own is not None:
        placed[target] = min(until, own.latest) if until else own.latest, IDENTITY
    return {name: Transform(time, target, name, pose[:3], pose[3:])
            for name, (time, pose) in placed.items() if pose is not None}


def _placed(lookups: Lookups, edges: dict[str, list[_Edge]], target: str, until: int
            ) -> dict[str, tuple[int, Optional[Pose]]]:
    """Find each frame's time (ns; 0: any) and pose, if it has one."""
    placed: dict[str, tuple[int, Optional[Pose]]] = {target: (0, IDENTITY)}
    names = [target]
    for name in names:
        time, pose = placed[name]
        for other, is_child, edge in edges.get(name, ()):
            if other in placed:
                continue
            names.append(other)
            latest = min(until, edge.latest) if until else edge.latest
            common = min(time, latest) if time and latest else time or latest
            placed[other] = common, None
            try:
                # The pose holds at the common time, and the edge has one parent only.
                if pose is not None and time in (0, common) and edge.parents is None:
                    step = Path((edge,), ()).pose(common)
                    placed[other] = common, compose(pose, step if is_child else inverse(step))
                else:
                    placed[other] = lookups.pose(target, other, common)
            except (NoPose, TransformException):
                pass  # those beyond may have another way, by parents that they had then
    return placed


def _edges(tree: FrameTree, until: int) -> dict[str, list[_Edge]]:
    """List the edges of every frame."""
    edges: dict[str, list[_Edge]] = {}
    for child, parent, history in tree.parents(until):
        edges.setdefault(parent, []).append((child, True, history))
        edges.setdefault(child, []).append((parent, False, history))
    return edges
