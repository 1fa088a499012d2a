"""The transforms between two frames in a bag, also those on other topics than TF's."""

from collections.abc import Sequence
from contextlib import suppress
import struct
from typing import Any, Optional

import numpy as np
from numpy.typing import NDArray

from puretf import SECOND, TransformBuffer
from puretf._text.names import comma_list
from puretf.bag import Bag, BagError, BagMessage

#: The types of topics that can be read as poses.
POSES = ('nav_msgs/msg/Odometry', 'geometry_msgs/msg/PoseStamped',
         'geometry_msgs/msg/PoseWithCovarianceStamped', 'geometry_msgs/msg/TransformStamped')


class PathReader:
    """Reads the transforms between two frames, and the stamps of another topic."""

    def __init__(self, frames: Sequence[str], at: Optional[str], topic: Optional[str]) -> None:
        """
        Read nothing yet.

        :param frames: the target frame and the source frame. With `at`, the target frame may be
            left out: then it is the frame_id of the messages. With `topic`, there are none.
        :param at: the name of a topic whose stamps are read, too.
        :param topic: the name of a topic of poses, which are read in place of TF.
        """
        self.frames, self._at, self._topic = frames, at, topic
        self.stamps: Optional[NDArray[np.int64]] = None  #: those of `at` (ns); None: no such topic

    def read(self, bag: Bag) -> TransformBuffer:
        """Read a bag in one pass; raise a BagError if it does not have what is wanted."""
        if self._topic:
            frame = f'topic {self._topic}'
            buffer, parents = _read_poses(bag, self._topic, frame)
            self.frames = _one_frame(self._topic, parents), frame
            return buffer
        if not self._at:
            return bag.read()
        stamps, frames = list[int](), set[str]()

        def add(message: BagMessage) -> None:
            if message.topic.name == self._at and message.topic.has_header:
                with suppress(struct.error):  # it is cut off
                    stamp, name, _ = message.encoding.header(message.data)
                    stamps.append(stamp)
                    frames.add(name.partition(b'\0')[0].decode(errors='replace').removeprefix('/'))

        buffer = bag.read(others=[self._at], on_message=add)
        if not stamps:
            for _ in bag.messages(tf=False, headers=True):
                pass
            found = sorted({each.name for each in bag.topics if each.headers.count})
            why = (f'no message on {self._at} has a header' if any(
                each.name == self._at for each in bag.topics) else f'there is no topic {self._at}')
            raise BagError(f'{why}; topics with headers: {comma_list(found) or "none"}')
        self.stamps = np.unique(np.array(stamps, np.int64))
        if len(self.frames) == 1:
            self.frames = _one_frame(self._at, frames, ': give both frames'), *self.frames
        return buffer


def _one_frame(topic: str, frames: set[str], remedy: str = '') -> str:
    if len(frames) != 1 or '' in frames:
        names = comma_list([name or "''" for name in sorted(frames)])
        raise BagError(f'the messages on {topic} must be in one frame, got {names or "none"}'
                       f'{remedy}')
    return next(iter(frames))


def _read_poses(bag: Bag, topic: str, child: str) -> tuple[TransformBuffer, set[str]]:
    """Return the poses on a topic as those of a child frame, and the names of the parents."""
    buffer, parents = TransformBuffer(2**63 - 1, max_samples=None), set()
    for message in bag.messages(tf=False, others=[topic]):
        if message.topic.msgtype in POSES and (decoded := message.decoded()):
            stamp, parent = decoded.header.stamp, decoded.header.frame_id.removeprefix('/')
            parents.add(parent)
            buffer.insert(stamp.sec * SECOND + stamp.nanosec, parent, child, _pose(decoded))
    found = [each.msgtype for each in bag.topics if each.name == topic]
    if set(found).isdisjoint(POSES):
        fitting = sorted({each.name for each in bag.topics if each.msgtype in POSES})
        raise BagError(
            f'{f"the type of {topic} is {found[0]}" if found else f"there is no topic {topic}"}; '
            f'it must be {", ".join(POSES[:-1])} or {POSES[-1]}; topics of these types: '
            f'{comma_list(fitting) or "none"}')
    return buffer, parents


def _pose(message: Any) -> tuple[float, float, float, float, float, float, float]:
    if hasattr(message, 'transform'):
        position, rotation = message.transform.translation, message.transform.rotation
    else:
        pose = getattr(message.pose, 'pose', message.pose)
        position, rotation = pose.position, pose.orientation
    return position.x, position.y, position.z, rotation.x, rotation.y, rotation.z, rotation.w
