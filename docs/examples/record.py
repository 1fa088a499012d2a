"""Record /tf and /tf_static, until Ctrl-C, into a bag for `ros2 bag play`: record.py DIRECTORY."""

import signal
import sys
from threading import Event

import rclpy
from rclpy.signals import SignalHandlerOptions
from rosbags import interfaces as dds
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

from dummy_arm.tf import Buffer
from dummy_arm.tf.publisher_listener import PublisherListener, Received

EVER = dds.QosTime(9223372036, 854775807)
TYPES = get_typestore(Stores.ROS2_JAZZY)

with Writer(sys.argv[1], version=9, storage_plugin=StoragePlugin.MCAP) as bag:
    moving, static = [
        bag.add_connection(topic, 'tf2_msgs/msg/TFMessage', typestore=TYPES, offered_qos_profiles=[
            dds.Qos(dds.QosHistory.KEEP_LAST, 100, dds.QosReliability.RELIABLE, durability, EVER,
                    EVER, dds.QosLiveliness.AUTOMATIC, EVER, False)])
        for topic, durability in (('/tf', dds.QosDurability.VOLATILE),
                                  ('/tf_static', dds.QosDurability.TRANSIENT_LOCAL))]

    def write(received: Received) -> None:
        """Write messages as they came in."""
        for message in received.messages:
            bag.write(static if message.is_static else moving, message.reception_time, message)
        if received.dropped:
            node.get_logger().error(
                f'{received.dropped} messages came too fast: they are not in the bag')

    ends = Event()
    for number in signal.SIGINT, signal.SIGTERM:  # neither interrupts a write
        signal.signal(number, lambda *_: ends.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('record')
    listener = PublisherListener(Buffer(node=node), node)
    node.get_logger().info('recording; Ctrl-C ends it, and only then is the bag complete')
    while not ends.is_set():
        rclpy.spin_once(node, timeout_sec=0.1)
        write(listener.received())
    listener.unregister()
    write(listener.received())  # the last ones
    rclpy.shutdown()
print(f'{sys.argv[1]}: {sum(bag.counts.values())} messages')
