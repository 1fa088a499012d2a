"""Samples of frames in the course of time: of one frame, or of some that always come together."""

from array import array
from bisect import bisect_left
from functools import cache
import struct
from typing import Any
from weakref import ref

import numpy as np

from dummy_arm.tf.wire import POSE_BYTES

#: What is `regular` while samples are not.
NO_STAMPS = array('q')


class Samples:
    """
    Stamps, and to each of them a row of poses: that of one frame, or of several.

    A pose is 7 float64: x, y, z (m) and the rotation's x, y, z, w. Rows before `start` have
    expired; they are removed many at a time. `regular` is `stamps`, but empty while two of them
    are the same or the parents differ. `latest` is the newest stamp, or 0. `recent` is where the
    last lookup was, as a hint for the next. `histories` refers to the histories of the frames, if
    there are several.
    """

    __slots__ = ('__weakref__', 'authority', 'histories', 'latest', 'poses', 'read_two', 'recent',
                 'regular', 'row', 'stamps', 'start')

    def __init__(self, frames: int = 1) -> None:
        """
        Begin with none.

        :param frames: how many poses a row has.
        """
        self.row = frames * POSE_BYTES
        #: Reads the poses of one frame in two rows that follow each other.
        self.read_two = _reader_of_two(frames)
        self.stamps = array('q')
        self.poses = bytearray()
        self.regular = self.stamps
        self.start = self.recent = self.latest = 0
        self.authority = ''
        self.histories: list[ref[Any]] = []

    def append(self, stamps: 'array[int]', poses: bytes, authority: str, cache_time: int) -> bool:
        """
        Append rows, if they are newer than all others; or one that is the last already.

        :param stamps: (n,) ns, each larger than the one before.
        :param poses: n rows.
        :returns: False when they do not belong there.
        """
        own = self.regular
        if not own:
            return False
        newest = own[-1]
        earliest = (newest if len(stamps) == 1 else stamps[-2]) - cache_time
        if stamps[0] > newest:
            try:
                self.poses += poses
                own.extend(stamps)
                self.latest = stamps[-1]
            except BaseException:
                self.mend(len(own))
                raise
        elif len(stamps) > 1 or stamps[0] < newest or not self.poses.endswith(poses):
            return False
        self.authority = authority
        if own[self.start] < earliest:
            self.drop_before(bisect_left(own, earliest, self.start))
        return True

    def drop_before(self, start: int) -> int:
        """
        Forget the rows before an index.

        :returns: how many were removed from memory, as `delete` does, from the second on: the
            first stays, so that the others move into their place, and the memory is used again.
        """
        self.start = start
        if start <= 16 or start * 5 <= len(self.stamps):
            return 0
        self.start = 1
        try:
            self.delete(1, start - 1)
        except BaseException:
            self.mend(1)
            raise
        return start - 1

    def delete(self, begin: int, count: int) -> None:
        """Remove rows from memory."""
        del self.poses[begin * self.row:(begin + count) * self.row]
        del self.stamps[begin:begin + count]

    def mend(self, position: int) -> None:
        """Undo an insertion or complete a deletion at an index, which Ctrl-C interrupted."""
        surplus = len(self.poses) // self.row - len(self.stamps)
        if surplus > 0:
            del self.poses[position * self.row:(position + surplus) * self.row]
        elif surplus < 0:
            del self.stamps[position:position - surplus]
        if self.stamps:
            self.latest = self.stamps[-1]

    def column(self, offset: int, begin: int, end: int) -> 'Samples':
        """
        Copy the samples of one frame.

        :param offset: of its pose in a row (bytes).
        :param begin: the first row.
        :param end: the row after the last.
        """
        column = Samples()
        column.stamps.extend(self.stamps[begin:end])
        column.poses += self.poses_of(offset)[begin:end].tobytes()
        column.latest, column.authority = column.stamps[-1], self.authority
        return column

    def poses_of(self, offset: int) -> Any:
        """
        View the poses of one frame, (n,) of 56 bytes each; while it is held, none can come in.

        :param offset: of its pose in a row (bytes).
        """
        return np.frombuffer(self.poses, f'V{POSE_BYTES}')[offset // POSE_BYTES::
                                                          self.row // POSE_BYTES]


@cache
def _reader_of_two(frames: int) -> Any:
    return struct.Struct(f'7d{(frames - 1) * POSE_BYTES}x7d').unpack_from
