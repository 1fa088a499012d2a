"""What goes into a buffer: checked and normalised, or refused in tf2's words."""

from array import array
from collections.abc import Mapping
from math import isfinite, nan
from operator import index
import struct
from typing import Any

import numpy as np

from dummy_arm.tf.history import Pose
from dummy_arm.tf.lookup import Lookups
from dummy_arm.tf.message_reader import Edges, Run
from dummy_arm.tf.refusals import problems, Refusals, too_many_frames, too_old
from dummy_arm.tf.rotations import normalize_poses, normalized
from dummy_arm.tf.wire import POSE_BYTES

_INT64 = 1 << 63
#: After so many samples that expired one by one, a history is asked to free their memory.
_EXPIRED_AT_ONCE = 64
_unpack_pose = struct.Struct('7d').unpack


class Intake:
    """Puts transforms into the tree of frames."""

    def __init__(self, lookups: Lookups, max_frames: int) -> None:
        """
        Begin.

        :param max_frames: how many frames there may be; transforms with more are refused.
        """
        self.refusals = Refusals()
        self._lookups = lookups
        self._max_frames = max_frames

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
            if not self._has_room(parent, child):
                self.refusals.tell_once('too many frames', too_many_frames(
                    child, self._max_frames, authority))
                return False
            if self._lookups.insert(stamp, parent, child, pose, authority, is_static):
                return True
        self.refusals.tell(too_old(child, stamp, authority))
        return False

    def _has_room(self, parent: str, child: str) -> bool:
        frames = self._lookups.tree.histories
        return ((child in frames and parent in frames)
                or len(frames) + (child not in frames) + (parent not in frames)
                <= self._max_frames)

    def insert_run(self, run: Run, authority: str) -> None:
        """
        Insert the transforms of some messages, of frames that move, each as `insert` does.

        Most are newer than all that is known of their frame, and have its only parent: those need
        no further check, once they are known to be finite. Those of one frame are appended at
        once.
        """
        edges, run_stamps, count = run.edges, run.stamps, len(run.stamps)
        number = len(edges.children)
        poses = np.frombuffer(bytearray().join(run.poses)).reshape(-1, POSE_BYTES // 8)
        are_finite = normalize_poses(poses)
        if not are_finite or not (count == 1 or (np.diff(run_stamps) > 0).all()):
            self._insert_each(run, range(count * number), authority)
            return
        if count > 1:
            poses = poses.reshape(count, number, -1).swapaxes(0, 1)
        data, size = poses.tobytes(), count * POSE_BYTES
        first, last, before_last = run_stamps[0], run_stamps[-1], run_stamps[-2:][0]
        cache_time = self._lookups.tree.cache_time
        with self._lookups.lock:
            if edges.found_in is not self._lookups.version:
                self._find(edges)
            for begin, history in zip(range(0, len(data), size), edges.found):
                if (history is None or not (stamps := history.regular)
                        or first <= (newest := stamps[-1])):
                    edge = begin // size
                    self._insert_each(run, range(edge, count * number, number), authority)
                    continue
                try:
                    samples = history.poses
                    samples += data[begin:begin + size]
                    stamps.extend(run_stamps)
                    history.latest = last
                    history.authority = authority
                    earliest = (newest if count == 1 else before_last) - cache_time
                    start = history.start
                    if stamps[start] < earliest:
                        start += 1
                        if stamps[start] < earliest or not start % _EXPIRED_AT_ONCE:
                            history.expire(earliest)
                        else:
                            history.start = start
                except BaseException:
                    history.mend(len(stamps))
                    raise

    def _find(self, edges: Edges) -> None:
        """Find the histories of frames that have the right parent, and no other."""
        histories: Mapping[str, Any] = self._lookups.tree.histories
        edges.found = [
            history if (history := histories.get(child)) and history.all_parents == (parent,)
            else None for parent, child in zip(edges.parents, edges.children)]
        edges.found_in = self._lookups.version

    def _insert_each(self, run: Run, indices: range, authority: str) -> None:
        edges = run.edges
        for i in indices:
            message, edge = divmod(i, len(edges.children))
            self.insert(run.stamps[message], edges.parents[edge], edges.children[edge],
                        _unpack_pose(run.poses[i]), authority, False)
