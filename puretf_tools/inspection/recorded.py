"""The transforms between two frames in a bag, also those on other topics than TF's."""

from collections.abc import Callable, Sequence
from contextlib import suppress
import struct
from typing import Any, NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray

from puretf import SECOND, TransformBuffer
from puretf._text.names import comma_list, namespace_path, TF_MESSAGE
from puretf.bag import Bag, BagError, BagMessage
from puretf_tools.inspection.bag_times import span_of
from puretf_tools.inspection.gaps import AnyBuffer

#: The types of topics that can be read as poses, and as transforms.
POSES = ('nav_msgs/msg/Odometry', 'geometry_msgs/msg/PoseStamped',
         'geometry_msgs/msg/PoseWithCovarianceStamped', 'geometry_msgs/msg/TransformStamped')
TRANSFORMS = 'geometry_msgs/msg/TransformStamped', TF_MESSAGE


class Recording(NamedTuple):
    """The transforms between two frames, and the bag that they are from."""

    buffer: AnyBuffer
    target: str
    source: str
    begin: Optional[int] = None  #: the first stamp of the bag (ns); None: there is no bag
    end: int = 0  #: the last stamp of the bag (ns)
    stamps: Optional[NDArray[np.int64]] = None  #: those on another topic (ns); None: no topic


def read(bag: Bag, frames: Sequence[str], at: Optional[str] = None, topic: Optional[str] = None,
         tf_topic: Optional[str] = None) -> Recording:
    """
    Read a bag, in one pass.

    :param frames: the target frame and the source frame. With `at`, the target frame may be left
        out: then it is the frame_id of the messages. With `topic`, there are none.
    :param at: the name of a topic whose stamps are read, too.
    :param topic: the name of a topic of poses, which are read in place of TF.
    :param tf_topic: the name of a topic of transforms, which are read as those of TF.
    :raises BagError: if the bag does not have what is wanted.
    """
    headers = _Headers(at or '')
    others = [at] if at else []
    if topic:
        frame = f'topic {topic}'
        buffer, parents = _read_topic(bag, topic, POSES, child=frame)
        frames = _one_frame(topic, parents), frame
    elif tf_topic:
        names = [f'{namespace_path(bag.namespace)}/{name}' for name in ('tf', 'tf_static')]
        buffer, _ = _read_topic(bag, tf_topic, TRANSFORMS, [*names, *others], headers.add)
    else:
        buffer = bag.read(others=others, on_message=headers.add if at else None)
    stamps = headers.stamps(bag) if at else None
    target, source = frames if len(frames) > 1 else (headers.frame(), *frames)
    span = span_of(buffer.frames(), (bag.begin, bag.end))
    return Recording(buffer, target, source, *span, stamps)


class _Headers:
    """The stamps and frames in the headers of all messages on a topic."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._stamps: list[int] = []
        self._frames: set[str] = set()

    def add(self, message: BagMessage) -> None:
        """Add a message, if it is on the topic."""
        if message.topic.name == self.topic and message.topic.has_header:
            with suppress(struct.error):  # it is cut off
                stamp, name, _ = message.encoding.header(message.data)
                self._stamps.append(stamp)
                self._frames.add(
                    name.partition(b'\0')[0].decode(errors='replace').removeprefix('/'))

    def stamps(self, bag: Bag) -> NDArray[np.int64]:
        """Return the stamps, sorted, each once; raise a BagError if there are none."""
        if not self._stamps:
            for _ in bag.messages(tf=False, headers=True):
                pass
            found = sorted({each.name for each in bag.topics if each.headers.count})
            raise BagError(f'no message on {self.topic} has a header; topics with headers: '
                           f'{comma_list(found) or "none"}')
        return np.unique(np.array(self._stamps, np.int64))

    def frame(self) -> str:
        return _one_frame(self.topic, self._frames, ': give both frames')


def _one_frame(topic: str, frames: set[str], remedy: str = '') -> str:
    """Return the only frame of messages on a topic, or raise a BagError."""
    if len(frames) != 1 or '' in frames:
        names = comma_list([name or "''" for name in sorted(frames)])
        raise BagError(f'the messages on {topic} must be in one frame, got {names or "none"}'
                       f'{remedy}')
    return next(iter(frames))


def _read_topic(bag: Bag, topic: str, types: Sequence[str], others: Sequence[str] = (),
                on_message: Callable[[BagMessage], object] = id, child: str = ''
                ) -> tuple[TransformBuffer, set[str]]:
    """
    Read the transforms or poses on a topic, and the TF messages on others.

    Return them with the names of the parents on the topic. All child frames on the topic get the
    name `child`, unless it is ''.
    """
    buffer, parents = TransformBuffer(2**63 - 1, max_samples=None), set()
    for message in bag.messages(tf=False, others=[topic, *others]):
        on_message(message)
        if message.topic.is_tf:
            with suppress(ValueError):  # it is malformed
                for row in message.rows():
                    buffer.insert(*row, message.publisher, message.is_static)
        elif message.topic.name == topic and message.topic.msgtype in types and (
                decoded := message.decoded()):
            stamp, parent = decoded.header.stamp, decoded.header.frame_id.removeprefix('/')
            parents.add(parent)
            buffer.insert(stamp.sec * SECOND + stamp.nanosec, parent,
                          child or decoded.child_frame_id, _pose(decoded))
    found = [each.msgtype for each in bag.topics if each.name == topic]
    if set(found).isdisjoint(types):
        fitting = sorted({each.name for each in bag.topics if each.msgtype in types})
        raise BagError(
            f'{f"the type of {topic} is {found[0]}" if found else f"there is no topic {topic}"}; '
            f'it must be {", ".join(types[:-1])} or {types[-1]}; topics of these types: '
            f'{comma_list(fitting) or "none"}')
    return buffer, parents


def _pose(message: Any) -> tuple[float, float, float, float, float, float, float]:
    """Return the pose in a message of a type in `POSES`."""
    if hasattr(message, 'transform'):
        position, rotation = message.transform.translation, message.transform.rotation
    else:
        pose = getattr(message.pose, 'pose', message.pose)
        position, rotation = pose.position, pose.orientation
    return position.x, position.y, position.z, rotation.x, rotation.y, rotation.z, rotation.w
