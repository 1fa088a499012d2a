"""The transforms and velocities that lookups of a `TransformBuffer` return."""

from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from puretf import rotations
from puretf._core.pose import Quaternion
from puretf._core.times import nanoseconds, nanoseconds_or_int, split
from puretf._text.distribution import require_ros
from puretf.exceptions import described

Vector = tuple[float, float, float]


class Twist(NamedTuple):
    """
    The velocity of a frame as seen in a target frame, in the axes of the target frame.

    :param linear: velocity of the origin of the frame: x, y, z (m/s)
    :param angular: angular velocity of the frame: x, y, z (rad/s)
    """

    linear: Vector
    angular: Vector


class Transform(NamedTuple):
    """
    The pose of the frame `child_frame_id` in the frame `frame_id`.

    It converts points from the child frame to `frame_id`. In the result of a lookup, `frame_id` is
    the target frame and `child_frame_id` the source frame. `target_from_source` is a good name for
    it: such names show that `a_from_b @ b_from_c` is `a_from_c`.

    :param stamp: time (ns)
    :param frame_id: the parent frame
    :param child_frame_id: the child frame
    :param translation: x, y, z (m)
    :param rotation: quaternion x, y, z, w
    """

    stamp: int
    frame_id: str
    child_frame_id: str
    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    @classmethod
    def from_message(cls, message: Any) -> 'Transform':
        """
        Create a transform from a geometry_msgs/TransformStamped, or an object with its fields.

        :raises TypeError: if the stamp has neither `nanoseconds` nor `sec` and `nanosec`.
        """
        stamp, transform = message.header.stamp, message.transform
        t, r = transform.translation, transform.rotation
        return cls(nanoseconds(stamp), message.header.frame_id, message.child_frame_id,
                   (t.x, t.y, t.z), (r.x, r.y, r.z, r.w))

    def to_message(self) -> Any:
        """
        Return a new geometry_msgs/TransformStamped.

        :raises ModuleNotFoundError: if geometry_msgs is not installed.
        """
        require_ros(['geometry_msgs'])
        # By name, since what imports this module must not need ROS.
        messages = import_module('geometry_msgs.msg')
        message = messages.TransformStamped(child_frame_id=self.child_frame_id)
        message.header.frame_id = self.frame_id
        message.header.stamp.sec, message.header.stamp.nanosec = split(
            nanoseconds_or_int(self.stamp, 'stamp'))
        x, y, z = map(float, self.translation)
        message.transform.translation = messages.Vector3(x=x, y=y, z=z)
        x, y, z, w = map(float, self.rotation)
        message.transform.rotation = messages.Quaternion(x=x, y=y, z=z, w=w)
        return message

    def matrix(self) -> NDArray[np.float64]:
        """Return the homogeneous matrix, (4, 4) float64, for column vectors x, y, z, 1 (m)."""
        result = np.eye(4)
        result[:3, :3] = rotations.matrix(self.rotation)
        result[:3, 3] = self.translation
        return result

    def apply(self, points: 'ArrayLike') -> NDArray[np.float64]:
        """
        Transform points from the child frame to `frame_id`.

        :param points: (3,) or (n, 3): x, y, z (m); the result has the same shape, in float64.
        :raises ValueError: if the points have another shape.
        """
        points = np.asarray(points, dtype=np.float64)
        if points.ndim not in (1, 2) or points.shape[-1] != 3:
            raise ValueError(f'points must be of shape (3,) or (n, 3), got {points.shape}')
        return np.asarray(points @ rotations.matrix(self.rotation).T + self.translation)

    def inverse(self) -> 'Transform':
        """Return the pose of `frame_id` in the child frame, with the same stamp."""
        rotation = rotations.conjugate(self.rotation)
        x, y, z = (-(rotations.matrix(rotation) @ self.translation)).tolist()
        return Transform(self.stamp, self.child_frame_id, self.frame_id, (x, y, z), rotation)

    def __matmul__(self, other: 'Transform') -> 'Transform':
        """
        Compose two transforms: a_from_b @ b_from_c is a_from_c, with the stamp of a_from_b.

        :raises ValueError: if the child frame of the left one is not the `frame_id` of the other.
        """
        if not isinstance(other, Transform):
            raise TypeError(f'@ takes a Transform, got {described(other)}; for points, write '
                            'transform.apply(points)')
        if self.child_frame_id != other.frame_id:
            raise ValueError(
                f'cannot compose {self.frame_id!r} from {self.child_frame_id!r} with '
                f'{other.frame_id!r} from {other.child_frame_id!r}: {self.child_frame_id!r} and '
                f'{other.frame_id!r} must be the same frame')
        x, y, z = self.apply(other.translation).tolist()
        return Transform(self.stamp, self.frame_id, other.child_frame_id, (x, y, z),
                         rotations.multiply(self.rotation, other.rotation))
