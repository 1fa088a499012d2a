"""Broadcasting transforms that stay, on /tf_static."""

from collections.abc import Iterable
from threading import Lock
from typing import Optional, Union

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from dummy_arm.tf._ros.messages import TFMessage
from dummy_arm.tf._ros.qos import profile
from dummy_arm.tf._ros.transform_stamped import as_list, explain_bad_fields, fields_to_send
from dummy_arm.tf._wire import cdr


class StaticTransformBroadcaster:
    """
    Sends static transforms on /tf_static, as the class of this name in tf2_ros does.

    Every message is latched and holds all that this broadcaster ever sent, the newest transform
    of each child, so that a later subscriber has them all at once. Transforms are copied.
    """

    def __init__(self, node: Node, qos: Optional[Union[QoSProfile, int]] = None) -> None:
        """
        Create the publisher.

        :param node: the node that publishes; its remappings apply.
        :param qos: profile of the publisher, or its depth; None: a depth of 1. Unless a profile
            says otherwise it is reliable and transient local.
        """
        self.pub_tf = node.create_publisher(
            TFMessage, '/tf_static',
            profile(qos, 1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
        self._sent: dict[str, cdr.Fields] = {}
        self._lock = Lock()

    def sendTransform(  # noqa: N802
            self, transform: Union[TransformStamped, Iterable[TransformStamped]]) -> None:
        """
        Send one transform, or any iterable of them, together with all sent before.

        :raises TypeError: on an element that is no TransformStamped.
        :raises ValueError: as `TransformBroadcaster.sendTransform`; nothing is changed then.
        """
        transforms = as_list(transform)
        with explain_bad_fields(transforms), self._lock:
            sent = dict(self._sent)
            for fields in fields_to_send(transforms):
                sent[fields[3].removeprefix('/')] = fields
            data = cdr.pack_fields(sent.values())
            self._sent = sent
            self.pub_tf.publish(data)
