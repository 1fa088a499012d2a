"""Publishing static transforms on /tf_static."""

# Before the packages of ROS, to say how to install them.
from puretf._ros.qos import check_node, profile, publish, TF_STATIC

# isort: split
from collections.abc import Iterable
from threading import RLock
from typing import Optional, Union

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from puretf._ros.messages import TFMessage
from puretf._ros.transform_stamped import as_list, explain_bad_fields, fields_to_send
from puretf._wire import cdr
from puretf._wire.encoding import Fields


class StaticTransformBroadcaster:
    """
    A publisher of static transforms, with the API of tf2_ros.StaticTransformBroadcaster.

    Each message contains the newest transform of each child frame, as it was when it was sent. By
    default, the last message is latched: DDS keeps it for subscribers that are created later.
    """

    def __init__(self, node: Node, qos: Optional[Union[QoSProfile, int]] = None, *,
                 tf_static_topic: str = '/tf_static',
                 qos_overriding_options: Optional[QoSOverridingOptions] = None) -> None:
        """
        Create the publisher; the remappings of the node apply.

        :param qos: the QoS profile of the publisher. An int is the depth of a reliable, transient
            local profile. None means the same as the int 1.
        :param qos_overriding_options: which policies parameters of the node can override.
        """
        check_node(node, 'StaticTransformBroadcaster(node)')
        self.pub_tf = node.create_publisher(
            TFMessage, tf_static_topic, profile(1 if qos is None else qos, TF_STATIC),
            qos_overriding_options=qos_overriding_options)
        self._node = node
        self._sent: dict[str, Fields] = {}
        self._lock = RLock()  # because a signal handler may send, too

    def sendTransform(  # noqa: N802
            self, transform: Union[TransformStamped, Iterable[TransformStamped]]) -> None:
        """
        Send transforms, together with the newest transform of each other child frame.

        If a transform is invalid, an error is raised as by `TransformBroadcaster.sendTransform`,
        nothing is sent, and the transforms that were sent before stay in effect.
        """
        self._send(as_list(transform))

    def replace(self, transforms: Iterable[TransformStamped]) -> None:
        """
        Send transforms in place of all that were sent before, which are not repeated any more.

        :raises TypeError: as `sendTransform`, and ValueError.
        """
        self._send([*transforms], replaces=True)

    def _send(self, transforms: list[TransformStamped], replaces: bool = False) -> None:
        with explain_bad_fields(transforms), self._lock:
            new = {fields[3].removeprefix('/'): fields for fields in fields_to_send(transforms)}
            sent = new if replaces else {**self._sent, **new}
            data = cdr.pack_fields(sent.values())  # raises the errors before anything changes
            self._sent = sent
            publish(self._node, self.pub_tf, data)
