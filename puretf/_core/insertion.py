"""Insertion of transforms into a tree of frames, after normalisation and checks."""

from collections.abc import Callable, Iterable
from functools import partial
import math
import struct
import sys
from time import monotonic_ns
from typing import Any, Optional

import numpy as np

from puretf._causes.explanation import old_data_end, publisher_end
from puretf._core import texts
from puretf._core.history import History, MAX_SAMPLES_PER_STAMP, StaticHistory
from puretf._core.lookup import Lookups
from puretf._core.pose import BatchOrRows, normalize_poses, normalized, Pose, POSE_BYTES, Rows
from puretf._text.names import is_too_long, LONGEST_NAME
from puretf._text.times import SECOND

#: One frame may have at most this number of samples per second of cache time.
_MAX_SAMPLES_PER_SECOND = 10_000
_unpack_pose = struct.Struct('7d').unpack


class Insertion:
    """The insertion of transforms into a tree of frames; callers must hold the buffer's lock."""

    def __init__(self, lookups: Lookups, max_frames: int, max_samples: Optional[int]) -> None:
        self.log = texts.ThrottledLog()
        self._tree, self._lookups = lookups.tree, lookups
        self._max_frames = max_frames
        self._max_samples = sys.maxsize if max_samples is None else max_samples
        #: The largest number of samples of one frame.
        self._max_samples_per_frame = sys.maxsize if max_samples is None else max(
            MAX_SAMPLES_PER_STAMP, _MAX_SAMPLES_PER_SECOND * self._tree.cache_time // SECOND)
        #: How many samples can be inserted before the buffer is full.
        self._room = self._max_samples

    def insert(self, stamp: int, parent: str, child: str, pose: Pose, authority: str,
               is_static: bool) -> bool:
        """
        Insert one transform, whose names have no leading slash and whose types are checked.

        A static pose replaces all samples of a dynamic frame, and a dynamic pose replaces a static
        one.
        """
        x, y, z, qx, qy, qz, qw = pose
        pose = (x, y, z, *normalized(qx, qy, qz, qw))
        if not (parent and child and parent != child and math.isfinite(x + y + z + pose[3])):
            if refusals := texts.refusals(
                    parent, child, pose, authority, not any((qx, qy, qz, qw))):
                self._tree.note_refusal(child, refusals[0][0], authority)
                for code, text in refusals:
                    self.log.warn(text.partition(' ')[0], text, f'{code} {child}', partial(
                        publisher_end, self._tree.look, authority, is_static))
                return False
            if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
                # tf2 accepts an infinite translation, and lookups in tf2 then return NaN. So NaN
                # is inserted here.
                pose = (math.nan, math.nan, math.nan, *pose[3:])
        histories = self._tree.histories
        history = histories.get(child)
        if (history is None or history.is_static is not is_static
                or parent not in history.all_parents):
            if not self._accepts_names(parent, child, authority, is_static):
                return False
            self._lookups.paths.clear()
            self._tree.note_parents(child)
            histories.setdefault(child, None)
            histories.setdefault(parent, None)
            if is_static:
                self._room += 0 if history is None or history.is_static else len(history)
                histories[child] = StaticHistory(parent, pose, authority)
                return True
        elif isinstance(history, StaticHistory):
            history.value, history.authority = pose, authority
            return True
        if history is None or history.is_static:
            histories[child] = history = History(self._tree.cache_time)
        stamps, length = history.stamps, len(history)
        before = stamps[-1] if stamps else 0
        is_accepted = history.insert(stamp, parent, pose, authority)
        self._room += length - (length := len(history))
        history.note_arrival(monotonic_ns(), stamps[-1] != before)
        if not is_accepted:
            self.log.warn('TF_OLD_DATA', texts.old_data(
                child, stamp, authority, history.latest, self._tree.cache_time), child, partial(
                    old_data_end, self._tree.look, authority))
            return False
        if self._room < 0 or length > self._max_samples_per_frame:
            self._drop_oldest(history, child, authority)
        return True

    def _accepts_names(self, parent: str, child: str, authority: str, is_static: bool) -> bool:
        """Return True if both names are short enough, and `max_frames` allows the new frames."""
        end = partial(publisher_end, self._tree.look, authority, is_static)
        if is_too_long(parent) or is_too_long(child):
            what, name = ('child_frame_id', child) if is_too_long(child) else ('frame_id', parent)
            self.log.warn('too long name', texts.too_long_name(
                child, what, name, LONGEST_NAME, authority), child, end)
            return False
        frames = self._tree.histories
        if len(frames) + (child not in frames) + (parent not in frames) > self._max_frames:
            self.log.warn('too many frames', texts.too_many_frames(
                child, self._max_frames, authority), end=end)
            return False
        return True

    def insert_batches(self, batches: Iterable[BatchOrRows]) -> bool:
        """
        Insert the transforms of messages, as if `insert` were called for each transform.

        Return False if one was refused.

        Most transforms of a batch are newer than all samples of their child frame, and have the
        same parent. If all poses of the batch are finite, such transforms are appended unchecked.
        """
        now, is_accepted = monotonic_ns(), True
        for batch in batches:
            if isinstance(batch, Rows):
                for stamp, parent, child, pose in batch.rows:
                    is_accepted &= self.insert(
                        stamp, parent.removeprefix('/'), child.removeprefix('/'), pose,
                        batch.authority, batch.is_static)
                continue
            for child in batch.children if batch.nanosec else ():
                self._tree.note_refusal(child, 'nanosec', batch.authority, batch.nanosec)
            number, count = len(batch.children), len(batch.stamps)
            poses = np.frombuffer(bytearray().join(batch.poses)).reshape(-1, 7)
            is_finite = normalize_poses(poses)
            by_frame = poses.reshape(count, number, 7).transpose(1, 0, 2).tobytes()
            size = count * POSE_BYTES
            for i, (parent, child) in enumerate(zip(batch.parents, batch.children)):
                history = self._tree.histories.get(child)
                if (is_finite and history is not None and not history.is_static
                        and history.only_parent == parent
                        and (length := len(history.stamps) - history.start)
                        and history.append(batch.stamps, by_frame[i * size:(i + 1) * size],
                                           batch.authority)):
                    history.note_arrival(now, True)
                    self._room += length - (length := len(history.stamps) - history.start)
                    if self._room < 0 or length > self._max_samples_per_frame:
                        self._drop_oldest(history, child, batch.authority)
                    continue
                for stamp, packed in zip(batch.stamps, batch.poses[i::number]):
                    is_accepted &= self.insert(stamp, parent, child, _unpack_pose(packed),
                                               batch.authority, False)
        return is_accepted

    def drop(self, method: Callable[..., None], *arguments: Any) -> None:
        """Call a method of the tree that drops samples; count those that are left."""
        method(*arguments)
        self._lookups.paths.clear()
        self._room = self._max_samples - sum(
            len(history) for _, history in self._tree.dynamic())

    def _drop_oldest(self, history: History, child: str, authority: str) -> None:
        """Drop the oldest samples of a frame if this frame or the whole buffer has too many."""
        of_frame, of_buffer = len(history) - self._max_samples_per_frame, -self._room
        surplus = max(of_frame, min(of_buffer, len(history) - 1))
        if surplus > 0:  # each frame keeps a sample
            history.is_full = True
            history.drop_before(history.start + surplus)
            self._room += surplus
            self.log.warn('too many samples', texts.too_many_samples(
                child, authority, min(self._max_samples_per_frame, self._max_samples),
                self._max_samples))
