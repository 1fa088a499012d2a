"""Broadcasting transforms that change with time, on /tf."""

from collections.abc import Iterable, Sequence
from typing import Any, Optional, Union

from geometry_msgs.msg import TransformStamped
import numpy as np
from numpy.typing import ArrayLike
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from dummy_arm.tf._core.times import nanoseconds_or_int
from dummy_arm.tf._ros.messages import TFMessage
from dummy_arm.tf._ros.transform_stamped import (
    as_list,
    check_edge,
    check_poses,
    explain_bad_fields,
    fields_to_send,
)
from dummy_arm.tf._wire import cdr


class TransformBroadcaster:
    """
    Sends transforms on /tf, as the class of this name in tf2_ros does.

    What no buffer would take raises an error that names the frame, and nothing is sent.
    """

    def __init__(self, node: Node, qos: Optional[Union[QoSProfile, int]] = None) -> None:
        """
        Create the publisher.

        :param node: the node that publishes; its remappings apply.
        :param qos: profile or depth of the publisher; None: reliable, volatile, the last 100.
        """
        self.pub_tf = node.create_publisher(
            TFMessage, '/tf', QoSProfile(depth=100) if qos is None else qos)

    def sendTransform(  # noqa: N802
            self, transform: Union[TransformStamped, Iterable[TransformStamped]]) -> None:
        """
        Send one transform, or any iterable of them in one message.

        :raises TypeError: on an element that is no TransformStamped.
        :raises ValueError: on an empty frame id, a parent that is its own child, a number that is
            not finite or a quaternion that cannot be normalised.
        """
        transforms = as_list(transform)
        with explain_bad_fields(transforms):
            self.pub_tf.publish(cdr.pack_fields(fields_to_send(transforms)))

    def prepare(self, edges: Sequence[tuple[str, str]]) -> 'PreparedTransforms':
        """
        Prepare a set of frames that is sent again and again, at a fraction of the cost.

        :param edges: n >= 1 pairs (frame_id, child_frame_id).
        :raises TypeError: on what is no pair of names.
        :raises ValueError: as `sendTransform`, for the names.
        """
        return PreparedTransforms(self.pub_tf, edges)


class PreparedTransforms:
    """Frames whose names were given once; see `TransformBroadcaster.prepare`."""

    def __init__(self, publisher: Publisher, edges: Sequence[tuple[str, str]]) -> None:
        self.edges = tuple(edges)
        if not self.edges:
            raise ValueError('a prepared set needs at least one (frame_id, child_frame_id)')
        for edge in self.edges:
            if isinstance(edge, str) or [*map(type, edge)] != [str, str]:
                raise TypeError(f'an edge must be two names, frame_id and child_frame_id; '
                                f'got {edge!r}')
            check_edge(*edge)
        self._packet = cdr.Packet(self.edges)
        self._publisher = publisher

    def send(self, stamp: Any, poses: ArrayLike) -> None:
        """
        Send a pose for every frame, in one message and with one stamp.

        :param stamp: time in ns, or what has `nanoseconds` (rclpy's Time) or `sec` and `nanosec`.
        :param poses: (n, 7) float64: the child's x, y, z (m) and quaternion x, y, z, w in its
            parent, in the order of the edges.
        :raises ValueError: on another shape, a number that is not finite, or a quaternion that
            cannot be normalised.
        """
        values = np.asarray(poses, np.float64)
        data = self._packet.pack(nanoseconds_or_int(stamp), values)
        check_poses(self.edges, values)
        self._publisher.publish(data)
