"""Record /tf and /tf_static, until Ctrl-C, into a bag for `ros2 bag play`: record.py DIRECTORY."""

from contextlib import suppress
import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rosbags import interfaces as dds
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

from dummy_arm.tf import Buffer
from dummy_arm.tf.senders import SenderListener, Sent

EVER = dds.QosTime(9223372036, 854775807)
TYPES = get_typestore(Stores.ROS2_JAZZY)

with Writer(sys.argv[1], version=9, storage_plugin=StoragePlugin.MCAP) as bag:
    moving, static = [
        bag.add_connection(topic, 'tf2_msgs/msg/TFMessage', typestore=TYPES, offered_qos_profiles=[
            dds.Qos(dds.QosHistory.KEEP_LAST, 100, dds.QosReliability.RELIABLE, durability, EVER,
                    EVER, dds.QosLiveliness.AUTOMATIC, EVER, False)])
        for topic, durability in (('/tf', dds.QosDurability.VOLATILE),
                                  ('/tf_static', dds.QosDurability.TRANSIENT_LOCAL))]

    def write(messages: list[Sent], is_static: bool) -> None:
        """Write messages as they came in."""
        for message in messages:
            bag.write(static if is_static else moving, message.received, message)

    rclpy.init()
    node = rclpy.create_node('record')
    listener = SenderListener(Buffer(node=node), node, observe=write)
    node.get_logger().info('recording; Ctrl-C ends it, and only then is the bag complete')
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    listener.unregister()  # which writes the last ones, too
print(f'{sys.argv[1]}: {sum(bag.counts.values())} messages')
