"""Types for a single pose, for a pose with names and a stamp, and for the poses of messages."""

from array import array
from typing import Any, NamedTuple, Union

#: x, y, z (m) and the quaternion x, y, z, w of the rotation.
Pose = tuple[float, float, float, float, float, float, float]
#: The quaternion x, y, z, w of a rotation.
Quaternion = tuple[float, float, float, float]
#: n poses: seven arrays of shape (n,). If all n poses are equal, the shape may be (1,).
Columns = tuple[Any, Any, Any, Any, Any, Any, Any]

#: The size of a pose (bytes) in histories and in messages: 7 float64.
POSE_BYTES = 7 * 8
#: The pose of a frame in itself.
IDENTITY: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class Row(NamedTuple):
    """One transform of a message; its values are not checked or changed."""

    stamp_ns: int  #: time (ns)
    frame_id: str  #: the parent, possibly with a leading slash
    child_frame_id: str  #: the child, possibly with a leading slash
    pose: Pose  #: x, y, z (m) and a quaternion x, y, z, w of any length


class Rows(NamedTuple):
    """The transforms of one message, which are inserted one by one."""

    rows: list[Row]
    authority: str  #: the publisher
    is_static: bool  #: True if the message is from /tf_static


class Batch:
    """m messages of /tf with the same n frames, in the order of their arrival."""

    def __init__(self, parents: list[str], children: list[str], authority: str) -> None:
        #: (n) names without a leading slash; no two children are equal.
        self.parents, self.children, self.authority = parents, children, authority
        #: (m,) one stamp (ns) for each message, strictly increasing.
        self.stamps = array('q')
        #: m * n poses, message by message, each as the bytes of 7 float64.
        self.poses: list[bytes] = []
        self.nanosec = 0  #: a `nanosec` of a stamp that is 10**9 or more; 0: there is none


BatchOrRows = Union[Batch, Rows]
