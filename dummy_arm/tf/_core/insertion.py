"""Insertion into a tree of frames: transforms are checked, normalised, kept or refused."""

from collections.abc import Iterable
from itertools import starmap
import math
import struct
import sys
from traceback import format_exc
from typing import Optional

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf._core.history import History, MOST_OF_ONE_STAMP
from dummy_arm.tf._core.lookup import Lookups
from dummy_arm.tf._core.pose import (
    BatchOrRows,
    is_too_long,
    LONGEST_NAME,
    normalized,
    Pose,
    POSE_BYTES,
    Rows,
)
from dummy_arm.tf._core.texts import logged, ThrottledLog
from dummy_arm.tf._core.times import display, SECOND

#: So many samples of a frame are kept for a second of cache time.
_PER_SECOND = 10_000
#: The number of rotations from which numpy is faster.
_MANY = 20
_unpack_pose = struct.Struct('7d').unpack


class Insertion:
    """Inserts transforms into a tree of frames; the lock of the buffer is held meanwhile."""

    def __init__(self, lookups: Lookups, max_frames: int, max_samples: Optional[int]) -> None:
        """
        Create what inserts into the tree of lookups.

        :param lookups: their paths are cleared when they become invalid.
        :param max_frames: how many frames there may be; transforms with more are refused.
        :param max_samples: how many samples there may be, of all frames; None: any number, of one
            frame, too.
        """
        self.log = ThrottledLog()
        self._tree, self._lookups = lookups.tree, lookups
        self._max_frames = max_frames
        self._max_samples = sys.maxsize if max_samples is None else max_samples
        #: Of one frame.
        self._most = sys.maxsize if max_samples is None else max(
            MOST_OF_ONE_STAMP, _PER_SECOND * self._tree.cache_time // SECOND)
        #: So many samples may come in until all are counted again.
        self._room = self._max_samples
        #: Whether the last count found no room; and how many have come in since then.
        self._is_full = False
        self._uncounted = 0

    def insert(self, stamp: int, frame_id: str, child_frame_id: str, pose: Pose, authority: str,
               is_static: bool) -> bool:
        """Insert one transform; as `Engine.insert`, of values of the right types."""
        return self._insert(stamp, frame_id.removeprefix('/'), child_frame_id.removeprefix('/'),
                            pose, authority, is_static)

    def _insert(self, stamp: int, parent: str, child: str, pose: Pose, authority: str,
                is_static: bool) -> bool:
        """Insert one transform whose names have lost their leading slash."""
        x, y, z, qx, qy, qz, qw = pose
        pose = (x, y, z, *normalized(qx, qy, qz, qw))
        if found := problems(parent, child, pose, authority):
            self.log.warn(*found)
            return False
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            # tf2 accepts infinite translations, and then answers NaN.
            pose = (math.nan, math.nan, math.nan, *pose[3:])
        if self._tree.has_edge(parent, child, is_static):
            is_accepted = self._tree.insert(stamp, parent, child, pose, authority, is_static)
        elif self._accepts_names(parent, child, authority):
            try:
                is_accepted = self._tree.insert(stamp, parent, child, pose, authority, is_static)
            finally:
                self._lookups.paths.clear()  # no function of ours, in which Ctrl-C may come
        else:
            return False
        if not is_accepted:
            self.log.warn(too_old(child, stamp, authority))
        elif not is_static:
            history = self._tree.histories[child]
            assert isinstance(history, History)
            self._room -= 1
            if self._room < 0 or len(history) > self._most:
                self._drop_oldest(history, 1, child, authority)
        return is_accepted

    def _accepts_names(self, parent: str, child: str, authority: str) -> bool:
        """Return whether two names may be those of frames."""
        if is_too_long(parent) or is_too_long(child):
            self.log.warn(too_long_name(parent, child, authority))
            return False
        frames = self._tree.histories
        if len(frames) + (child not in frames) + (parent not in frames) > self._max_frames:
            self.log.warn_once('too many frames', too_many_frames(
                child, self._max_frames, authority))
            return False
        return True

    def insert_batches(self, batches: Iterable[BatchOrRows]) -> None:
        """
        Insert the transforms of messages, each as `insert` does.

        Most transforms of a batch are newer than everything that is known of their frame, and have
        its only parent: those need no further check, once they are known to be finite.
        """
        for batch in batches:
            try:
                if isinstance(batch, Rows):
                    for stamp, parent, child, pose in batch.rows:
                        self.insert(stamp, parent, child, pose, batch.authority, batch.is_static)
                    continue
                number, count = len(batch.children), len(batch.stamps)
                poses = np.frombuffer(bytearray().join(batch.poses)).reshape(-1, 7)
                is_finite = normalize_poses(poses)
                by_frame = poses.reshape(count, number, 7).transpose(1, 0, 2).tobytes()
                size = count * POSE_BYTES
                for i, (parent, child) in enumerate(zip(batch.parents, batch.children)):
                    history = self._tree.histories.get(child)
                    if (is_finite and isinstance(history, History)
                            and history.only_parent == parent
                            and history.append(batch.stamps, by_frame[i * size:(i + 1) * size],
                                               batch.authority)):
                        self._room -= count
                        if self._room < 0 or len(history.stamps) - history.start > self._most:
                            self._drop_oldest(history, count, child, batch.authority)
                        continue
                    for stamp, packed in zip(batch.stamps, batch.poses[i::number]):
                        self._insert(stamp, parent, child, _unpack_pose(packed),
                                     batch.authority, False)
            except Exception:  # a fault of this package; the next batches may be good
                self.log.warn(format_exc())

    def _drop_oldest(self, history: History, added: int, child: str, authority: str) -> None:
        """
        Drop the oldest samples of a frame that has got new ones, as far as there are too many.

        :param added: the number of samples that the frame has got.
        """
        surplus = len(history) - self._most
        if surplus > 0:
            history.drop_before(history.start + surplus)
            self._room += surplus
            self.log.warn_once('frame', too_many_samples_of_a_frame(
                child, self._most, authority))
        if self._room >= 0:
            return
        # To count takes a moment for every frame, so while the buffer is full it is done now and
        # then only, and a sample that comes in between takes the place of another.
        self._uncounted += added
        surplus = added
        if not self._is_full or 8 * self._uncounted >= len(self._tree.histories):
            self._uncounted = 0
            self._room = self._max_samples - sum(
                len(history) for history in self._tree.histories.values()
                if isinstance(history, History))
            self._is_full = self._room <= 0
            surplus = min(added, -self._room)
        surplus = min(surplus, len(history) - 1)
        if surplus > 0:
            history.drop_before(history.start + surplus)
            self._room += surplus
            self.log.warn_once('buffer', too_many_samples(
                child, self._max_samples, authority))


def normalize_poses(poses: NDArray[np.float64]) -> bool:
    """
    Normalise the rotations of many poses, each as `normalized` does.

    :param poses: (n, 7) x, y, z, qx, qy, qz, qw; changed in place.
    :returns: True if everything is finite. False also for numbers so large that their sum is not.
    """
    rotations = poses[:, 3:]
    if len(poses) < _MANY:
        rotations[:] = [*starmap(normalized, rotations.tolist())]
        return all(map(math.isfinite, poses.ravel().tolist()))
    q = rotations.T.copy()
    result = np.empty_like(q)
    with np.errstate(all='ignore'):
        doubled = q[:3] * (2.0 / np.add.reduce(q * q))
        w_xyz = q[3] * doubled
        products = q[:3, np.newaxis] * doubled
        xx, yy, zz = products[0, 0], products[1, 1], products[2, 2]
        mixed = np.array((products[1, 2], products[0, 2], products[0, 1]))
        trace = 1.0 - (yy + zz)
        trace += 1.0 - (xx + zz)
        trace += 1.0 - (xx + yy)
        root = np.sqrt(trace + 1.0)
        above, below = mixed + w_xyz, mixed - w_xyz
        np.multiply(above - below, 0.5 / root, result[:3])
        np.multiply(root, 0.5, result[3])
        if not trace.min() > 0.0:
            diagonal = 1.0 - np.array((yy + zz, xx + zz, xx + yy))
            _large_angles(~(trace > 0.0), diagonal, above, below, result)
        rotations[:] = result.T
        return math.isfinite(poses.sum())


def _large_angles(
        rows: NDArray[np.bool_], diagonal: NDArray[np.float64], above: NDArray[np.float64],
        below: NDArray[np.float64], result: NDArray[np.float64]) -> None:
    """
    Set some quaternions of matrices whose trace is not positive.

    :param above: (3, n) the elements 21, 02, 10.
    :param below: (3, n) the elements 12, 20, 01.
    """
    m0, m1, m2 = diagonal
    largest = np.where(np.where(m0 >= m1, m0, m1) < m2, 2, np.where(m0 < m1, 1, 0))
    for i, j, k in (0, 1, 2), (1, 2, 0), (2, 0, 1):
        n = (rows & (largest == i)).nonzero()[0]
        if len(n):
            root = np.sqrt(diagonal[i, n] - diagonal[j, n] - diagonal[k, n] + 1.0)
            scale = 0.5 / root
            result[i, n] = root * 0.5
            result[j, n] = (above[k, n] + below[k, n]) * scale
            result[k, n] = (above[j, n] + below[j, n]) * scale
            result[3, n] = (above[i, n] - below[i, n]) * scale


def problems(parent: str, child: str, pose: Pose, authority: str) -> list[str]:
    """
    List all that is wrong with a transform.

    :param pose: with the rotation normalised, NaN where that cannot be.
    """
    if parent != child and parent and child and not any(map(math.isnan, pose)):
        return []
    found = []
    is_own_parent = parent == child
    child, authority = logged(child), logged(authority)
    numbers = '({:f} {:f} {:f}) ({:f} {:f} {:f} {:f})'.format(*pose)
    if is_own_parent:
        found.append(f'TF_SELF_TRANSFORM: Ignoring transform from authority "{authority}" with '
                     f'frame_id and  child_frame_id "{child}" because they are the same')
    if not child:
        found.append(f'TF_NO_CHILD_FRAME_ID: Ignoring transform from authority "{authority}" '
                     'because child_frame_id not set ')
    if not parent:
        found.append(f'TF_NO_FRAME_ID: Ignoring transform with child_frame_id "{child}"  from '
                     f'authority "{authority}" because frame_id not set')
    if any(map(math.isnan, pose)):
        found.append(f'TF_NAN_INPUT: Ignoring transform for child_frame_id "{child}" from '
                     f'authority "{authority}" because of a nan value in the transform {numbers}')
    if any(map(math.isnan, pose[3:])):
        found.append('TF_DENORMALIZED_QUATERNION: Ignoring transform for child_frame_id '
                     f'"{child}" from authority "{authority}" because of an invalid quaternion '
                     f'in the transform {numbers.partition(") ")[2]}')
    return found


def too_old(child: str, stamp: int, authority: str) -> str:
    """Tell that a transform is older than the cache time allows."""
    return (f'TF_OLD_DATA ignoring data from the past for frame {logged(child)} at time '
            f'{display(stamp)} according to authority {logged(authority)}\n'
            'Possible reasons are listed at http://wiki.ros.org/tf/Errors%20explained')


def too_many_frames(child: str, limit: int, authority: str) -> str:
    """Tell that a frame is new and there may be no more."""
    return (f'TF_TOO_MANY_FRAMES: Ignoring transform for child_frame_id "{logged(child)}" from '
            f'authority "{logged(authority)}", and every other with a new frame: {limit} frames '
            'are known, and no more are allowed (max_frames of the buffer). Does something send '
            'ever new names?')


def too_long_name(parent: str, child: str, authority: str) -> str:
    """Return the warning for a transform one of whose names is too long."""
    what, name = ('child_frame_id', child) if is_too_long(child) else ('frame_id', parent)
    size = len(name.encode('utf-8', 'surrogatepass'))
    return (f'TF_LONG_FRAME_ID: Ignoring transform for child_frame_id "{logged(child)}" from '
            f'authority "{logged(authority)}" because its {what} has {size} bytes: no more than '
            f'{LONGEST_NAME} are allowed')


def too_many_samples_of_a_frame(child: str, limit: int, authority: str) -> str:
    """Return the warning for a frame of which more transforms come than are kept."""
    return (f'TF_TOO_MANY_SAMPLES: Dropping the oldest transforms of child_frame_id '
            f'"{logged(child)}" from authority "{logged(authority)}", and of every other such '
            f'frame, before the cache time is over: of a frame, {limit} are kept, which is 10000 '
            'per second of cache time. Do its stamps hardly advance?')


def too_many_samples(child: str, limit: int, authority: str) -> str:
    """Return the warning for a buffer into which more transforms come than are kept."""
    return (f'TF_FULL_BUFFER: Dropping the oldest transforms of child_frame_id "{logged(child)}" '
            f'from authority "{logged(authority)}", and of every other frame that gets new ones, '
            f'before the cache time is over: the buffer has {limit}, and no more are kept '
            '(max_samples of the buffer). Is its cache time too long?')


