"""What goes into a buffer: checked and normalised, or refused in tf2's words."""

from array import array
from collections.abc import Sequence
from math import isfinite, nan
from operator import index
import struct
import sys
from typing import Optional
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from dummy_arm.tf.common_samples import in_common
from dummy_arm.tf.history import History, MOST_OF_ONE_STAMP, Pose
from dummy_arm.tf.lookup import Lookups
from dummy_arm.tf.message_reader import Edges, nothing, Run
from dummy_arm.tf.normalization import normalize_poses, normalized
from dummy_arm.tf.refusals import (
    is_too_long,
    problems,
    Refusals,
    too_long_name,
    too_many_frames,
    too_many_samples,
    too_many_samples_of_a_frame,
    too_old,
)
from dummy_arm.tf.samples import Samples
from dummy_arm.tf.times import SECOND

_INT64 = 1 << 63
#: So many samples of a frame are kept for a second of cache time.
_PER_SECOND = 10_000
_unpack_pose = struct.Struct('7d').unpack


class Intake:
    """Puts transforms into the tree of frames."""

    def __init__(self, lookups: Lookups, max_frames: int, max_samples: Optional[int]) -> None:
        """
        Begin.

        :param max_frames: how many frames there may be; transforms with more are refused.
        :param max_samples: how many samples there may be, of all frames; None: any number, of one
            frame, too.
        """
        self.refusals = Refusals()
        self._lookups = lookups
        self._max_frames = max_frames
        self._max_samples = sys.maxsize if max_samples is None else max_samples
        #: Of one frame.
        self._most = sys.maxsize if max_samples is None else max(
            MOST_OF_ONE_STAMP, _PER_SECOND * lookups.tree.cache_time // SECOND)
        #: So many samples may come in until all are counted again.
        self._room = self._max_samples
        #: Whether the last count found no room; and how many have come in since then.
        self._is_full = False
        self._uncounted = 0

    def insert(self, stamp: int, frame_id: str, child_frame_id: str, pose: Pose, authority: str,
               is_static: bool) -> bool:
        """Insert one transform; as `BufferCore.insert`."""
        if not (isinstance(frame_id, str) and isinstance(child_frame_id, str)):
            raise TypeError(f'a frame id must be a str, got {frame_id!r} and {child_frame_id!r}')
        stamp = index(stamp)
        if not -_INT64 <= stamp < _INT64:
            raise OverflowError(f'a stamp must be an int64 of ns, got {stamp}')
        parent, child = frame_id.removeprefix('/'), child_frame_id.removeprefix('/')
        x, y, z, qx, qy, qz, qw = array('d', pose)
        pose = (x, y, z, *normalized(qx, qy, qz, qw))
        if found := problems(parent, child, pose, authority):
            self.refusals.tell(*found)
            return False
        if not (isfinite(x) and isfinite(y) and isfinite(z)):
            pose = (nan, nan, nan, *pose[3:])  # as tf2 answers, although it takes infinity
        with self._lookups.lock:
            frames = self._lookups.tree.histories
            if not (child in frames and parent in frames) and not self._takes_names(
                    parent, child, authority):
                return False
            if self._lookups.insert(stamp, parent, child, pose, authority, is_static):
                if not is_static:
                    history = frames[child]
                    assert isinstance(history, History)
                    self._room -= 1
                    if self._room < 0 or len(history) > self._most:
                        self._drop_oldest([history], 1, child, authority)
                return True
        self.refusals.tell(too_old(child, stamp, authority))
        return False

    def _takes_names(self, parent: str, child: str, authority: str) -> bool:
        """Return whether two names, at least one of them new, may become frames."""
        if is_too_long(parent) or is_too_long(child):
            self.refusals.tell(too_long_name(parent, child, authority))
            return False
        frames = self._lookups.tree.histories
        if len(frames) + (child not in frames) + (parent not in frames) > self._max_frames:
            self.refusals.tell_once('too many frames', too_many_frames(
                child, self._max_frames, authority))
            return False
        return True

    def _drop_oldest(self, histories: Sequence[History], added: int, child: str, authority: str
                     ) -> None:
        """
        Drop the oldest samples of frames that have got new ones, as far as there are too many.

        :param histories: those of the frames; several of them have their samples in common.
        :param added: the number of samples that each has got.
        :param child: the first of the frames, for the log.
        """
        number, first = len(histories), histories[0]
        surplus = len(first) - self._most
        if surplus > 0:
            self._drop(histories, surplus)
            self.refusals.tell_once('frame', too_many_samples_of_a_frame(
                child, self._most, authority))
        if self._room >= 0:
            return
        # To count takes a moment for every frame, so while the buffer is full it is done now and
        # then only, and a sample that comes in between takes the place of another.
        self._uncounted += added * number
        surplus = added
        if not self._is_full or 8 * self._uncounted >= len(self._lookups.tree.histories):
            self._uncounted = 0
            self._room = self._max_samples - sum(
                len(history) for history in self._lookups.tree.histories.values()
                if isinstance(history, History))
            self._is_full = self._room <= 0
            surplus = min(added, -(self._room // number))
        surplus = min(surplus, len(first) - 1)
        if surplus > 0:
            self._drop(histories, surplus)
            self.refusals.tell_once('buffer', too_many_samples(
                child, self._max_samples, authority))

    def _drop(self, histories: Sequence[History], count: int) -> None:
        """Drop the oldest samples of frames; of one, or of some that have them in common."""
        first = histories[0]
        if first.drop_before(first.place[0].start + count):
            self._lookups.has_changed()
        self._room += count * len(histories)

    def insert_run(self, run: Run, authority: str) -> None:
        """
        Insert the transforms of some messages, of frames that move, each as `insert` does.

        Most are newer than all that is known of their frame, and have its only parent: those need
        no further check, once they are known to be finite.
        """
        number, count = len(run.edges.children), len(run.stamps)
        poses = np.frombuffer(bytearray().join(run.poses)).reshape(count * number, -1)
        if normalize_poses(poses):
            with self._lookups.lock:
                self._append(run, 0, poses.reshape(count, number, -1), authority)
        else:
            self._insert_each(run, range(count * number), authority)

    def _append(self, run: Run, begin: int, poses: NDArray[np.float64], authority: str) -> None:
        """
        Append messages of a run to the samples of their frames.

        :param begin: the first of m messages of n transforms.
        :param poses: (m, n, 7), normalised.
        """
        edges, (count, number, _) = run.edges, poses.shape
        stamps = run.stamps[begin:begin + count]
        cache_time = self._lookups.tree.cache_time
        common = edges.common()
        if edges.found_in is not self._lookups.version or common is None:
            common = self._find(edges, stamps[0])
        if common is not None:
            if common.append(stamps, poses.tobytes(), authority, cache_time):
                self._room -= count * number
                if self._room < 0 or len(common.stamps) - common.start > self._most:
                    histories = [found() for found in edges.found]
                    self._drop_oldest(histories, count, edges.children[0], authority)
                return
            if count > 1:
                for i in range(count):
                    self._append(run, begin + i, poses[i:i + 1], authority)
                return
        for i, found in enumerate(edges.found):
            history = found()
            if history is None or not history.own_samples().append(
                    stamps, poses[:, i].tobytes(), authority, cache_time):
                self._insert_each(run, range(
                    begin * number + i, (begin + count) * number, number), authority)
                continue
            self._room -= count
            if self._room < 0 or len(history) > self._most:
                self._drop_oldest([history], count, edges.children[i], authority)

    def _find(self, edges: Edges, stamp: int) -> Optional[Samples]:
        """
        Find the histories of frames that move, have the right parent, and no other.

        :param stamp: of what is inserted now (ns): frames that were parted may have their samples
            in common again after a cache time, or when time has gone back.
        :returns: the samples that they have in common, if so.
        """
        is_found = edges.found_in is self._lookups.version
        if is_found and edges.common is not nothing:  # they were parted just now
            edges.common, edges.parted = nothing, stamp
        may_begin = edges.parted is None or not (
            edges.parted <= stamp < edges.parted + self._lookups.tree.cache_time)
        if is_found and not may_begin:
            return None
        histories = self._lookups.tree.histories
        found = [
            history if isinstance(history := histories.get(child), History)
            and history.only_parent == parent else None
            for parent, child in zip(edges.parents, edges.children)]
        common = in_common(found, may_begin)
        if common is None and is_found:
            edges.parted = stamp
        edges.found = [nothing if history is None else ref(history) for history in found]
        edges.common = nothing if common is None else ref(common)
        edges.found_in = self._lookups.version
        return common

    def _insert_each(self, run: Run, indices: range, authority: str) -> None:
        edges = run.edges
        for i in indices:
            message, edge = divmod(i, len(edges.children))
            self.insert(run.stamps[message], edges.parents[edge], edges.children[edge],
                        _unpack_pose(run.poses[i]), authority, False)
