"""Record /tf and /tf_static into a bag that `ros2 bag play` takes, until Ctrl-C: record.py BAG."""

from contextlib import suppress
import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

from dummy_arm.tf import Buffer
from dummy_arm.tf.senders import SenderListener, Sent

EVER = QosTime(9223372036, 854775807)

rclpy.init()
node = rclpy.create_node('record')
with Writer(sys.argv[1], version=9, storage_plugin=StoragePlugin.MCAP) as bag:
    moving, static = [
        bag.add_connection(
            topic, 'tf2_msgs/msg/TFMessage', typestore=get_typestore(Stores.ROS2_JAZZY),
            offered_qos_profiles=[Qos(
                QosHistory.KEEP_LAST, 100, QosReliability.RELIABLE, durability, EVER, EVER,
                QosLiveliness.AUTOMATIC, EVER, False)])
        for topic, durability in (('/tf', QosDurability.VOLATILE),
                                  ('/tf_static', QosDurability.TRANSIENT_LOCAL))]

    def write(messages: list[Sent], is_static: bool) -> None:
        """Write messages as they came in."""
        for message in messages:
            bag.write(static if is_static else moving, message.received, message)

    listener = SenderListener(Buffer(node=node), node, observe=write)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    listener.unregister()  # which writes the last ones, too
