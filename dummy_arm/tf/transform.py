"""The value that a lookup gives."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dummy_arm.tf import rotations
from dummy_arm.tf._core.pose import Quaternion
from dummy_arm.tf._core.times import nanoseconds

Vector = tuple[float, float, float]


class Transform(NamedTuple):
    """
    The pose of the frame `child_frame_id` in the frame `frame_id`.

    So it takes points from the child frame to `frame_id`; what a lookup of target and source gives
    has the target as `frame_id` and the source as `child_frame_id`. In names: target_from_source.
    `a_from_b @ b_from_c` is a_from_c.
    """

    stamp: int  #: ns
    frame_id: str
    child_frame_id: str
    translation: Vector = (0.0, 0.0, 0.0)  #: x, y, z (m)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)  #: x, y, z, w

    @classmethod
    def from_message(cls, message: Any) -> 'Transform':
        """
        Create the transform of a message.

        :param message: a geometry_msgs/TransformStamped, or what has its fields.
        """
        stamp, transform = message.header.stamp, message.transform
        t, r = transform.translation, transform.rotation
        return cls(nanoseconds(stamp), message.header.frame_id, message.child_frame_id,
                   (t.x, t.y, t.z), (r.x, r.y, r.z, r.w))

    def matrix(self) -> NDArray[np.float64]:
        """Write it as a homogenous (4, 4) matrix."""
        result = np.eye(4)
        result[:3, :3] = rotations.matrix(self.rotation)
        result[:3, 3] = self.translation
        return result

    def apply(self, points: ArrayLike) -> NDArray[np.float64]:
        """
        Take points from the child frame to `frame_id`.

        :param points: (3,) or (n, 3), m.
        :returns: the same shape.
        :raises ValueError: on another shape.
        """
        points = np.asarray(points, dtype=np.float64)
        if points.ndim not in (1, 2) or points.shape[-1] != 3:
            raise ValueError(f'points must be of shape (3,) or (n, 3), got {points.shape}')
        result: NDArray[np.float64] = points @ rotations.matrix(self.rotation).T + self.translation
        return result

    def inverse(self) -> 'Transform':
        """Exchange the frames: the pose of `frame_id` in the child frame."""
        back = rotations.conjugate(self.rotation)
        x, y, z = (-(rotations.matrix(back) @ self.translation)).tolist()
        return Transform(self.stamp, self.child_frame_id, self.frame_id, (x, y, z), back)

    def __matmul__(self, other: 'Transform') -> 'Transform':
        """
        Compose a_from_b @ b_from_c; the stamp is that of the left one.

        :raises ValueError: when the frames between do not match.
        """
        if not isinstance(other, Transform):
            return NotImplemented
        if self.child_frame_id != other.frame_id:
            raise ValueError(
                f'cannot compose {self.frame_id!r} from {self.child_frame_id!r} with '
                f'{other.frame_id!r} from {other.child_frame_id!r}: the frames between must be '
                'the same')
        x, y, z = self.apply(other.translation).tolist()
        return Transform(self.stamp, self.frame_id, other.child_frame_id, (x, y, z),
                         rotations.multiply(self.rotation, other.rotation))
