"""Publishing dynamic transforms on /tf."""

# Before the packages of ROS, to say how to install them.
from puretf._ros.graph import broadcast

# isort: split
from collections.abc import Iterable, Sequence
from typing import Any, Optional, Union

from geometry_msgs.msg import TransformStamped
import numpy as np
from numpy.typing import ArrayLike
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from puretf._core.pose import normalize_poses
from puretf._core.times import nanoseconds_or_int
from puretf._ros import transform_stamped
from puretf._ros.messages import TFMessage
from puretf._ros.qos import check_node, profile, publish, TF
from puretf._wire import cdr
from puretf._wire.encoding import CDR
from puretf._wire.message_reader import Layout
from puretf.exceptions import described

#: The largest number of frames that are remembered for the texts of errors.
_MOST_CHILDREN = 10_000


class TransformBroadcaster:
    """
    A publisher of dynamic transforms, with the API of tf2_ros.TransformBroadcaster.

    Transforms are checked before they are sent. If a transform is invalid, the call raises an
    error that names the frames of this transform, and nothing is sent.
    """

    def __init__(self, node: Node, qos: Optional[Union[QoSProfile, int]] = None, *,
                 tf_topic: str = '/tf',
                 qos_overriding_options: Optional[QoSOverridingOptions] = None) -> None:
        """
        Create the publisher; the remappings of the node apply.

        :param qos: the QoS profile of the publisher. An int is the depth of a reliable, volatile
            profile. None means the same as the int 100.
        :param qos_overriding_options: which policies parameters of the node can override.
        """
        check_node(node, 'TransformBroadcaster(node)')
        self.pub_tf = node.create_publisher(
            TFMessage, tf_topic, profile(qos, TF), qos_overriding_options=qos_overriding_options)
        self._node = node
        self._children = broadcast.setdefault(node, set())

    def sendTransform(  # noqa: N802
            self, transform: Union[TransformStamped, Iterable[TransformStamped]]) -> None:
        """
        Send one or several transforms in one message.

        :raises TypeError: if an element is not a TransformStamped.
        :raises ValueError: if a frame id is empty, contains a NUL character or is not valid
            Unicode; if a frame is its own parent; if a number is not finite; if a quaternion
            cannot be normalised; or if the value of a field has a wrong type or does not fit the
            field.
        :raises ExternalShutdownException: if ROS has been shut down, such as by Ctrl-C.
        """
        transforms = transform_stamped.as_list(transform)
        with transform_stamped.explain_bad_fields(transforms):
            fields = [*transform_stamped.fields_to_send(transforms)]
            publish(self._node, self.pub_tf, cdr.pack_fields(fields))
        self._note(child for _, _, _, child, _ in fields)

    def _note(self, children: Iterable[str]) -> None:
        if len(self._children) < _MOST_CHILDREN:
            self._children.update(children)

    def prepare(self, edges: Sequence[tuple[str, str]]) -> 'PreparedTransforms':
        """
        Prepare a message that is sent many times with the same frames, so that sending is fast.

        :param edges: n >= 1 pairs (frame_id, child_frame_id).
        :raises TypeError: if an edge is not a pair of str.
        :raises ValueError: if there is no edge, or if the names of an edge are invalid; see
            `sendTransform`.
        """
        prepared = PreparedTransforms(self._node, self.pub_tf, edges)
        self._note(child for _, child in prepared.edges)
        return prepared


class PreparedTransforms:
    """A message on /tf whose frames stay the same; see `TransformBroadcaster.prepare`."""

    def __init__(self, node: Node, publisher: Publisher, edges: Sequence[tuple[str, str]]) -> None:
        """Create a message of a publisher; see `TransformBroadcaster.prepare`."""
        self.edges = tuple(edges)
        if not self.edges:
            raise ValueError('edges must contain at least one pair (frame_id, child_frame_id)')
        for edge in self.edges:
            if (isinstance(edge, str) or not isinstance(edge, Sequence)
                    or [*map(type, edge)] != [str, str]):
                raise TypeError('an edge must be two names, frame_id and child_frame_id; '
                                f'got {described(edge)}')
            transform_stamped.check_edge(*edge)
        self._layout = Layout(CDR, self.edges)
        self._node, self._publisher = node, publisher

    def send(self, stamp: Any, poses: 'ArrayLike') -> None:
        """
        Send one pose for each edge, in one message; all poses have the same stamp.

        :param stamp: an int (ns), a Time of rclpy, or a Time message.
        :param poses: (n, 7) float64: one row for each edge, in the order of `edges`. A row is the
            pose of the child frame in its parent: x, y, z (m) and the quaternion x, y, z, w.
        :raises TypeError: if the stamp has another type.
        :raises ValueError: if the poses have another shape; if a number is not finite; if a
            quaternion cannot be normalised; or if the seconds of the stamp do not fit an int32.
        """
        values = np.asarray(poses, np.float64)
        data = self._layout.pack(nanoseconds_or_int(stamp), values)
        if not normalize_poses(values.copy()):
            for edge, pose in zip(self.edges, values.tolist()):
                transform_stamped.check_pose(*edge, pose)
        publish(self._node, self._publisher, data)
