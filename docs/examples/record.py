"""
Record /tf and /tf_static until Ctrl-C, into a bag that `ros2 bag play` can play.

Usage: record.py DIRECTORY
"""

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

INFINITE = dds.QosTime(9223372036, 854775807)
TYPES = get_typestore(Stores.ROS2_JAZZY)

with Writer(sys.argv[1], version=9, storage_plugin=StoragePlugin.MCAP) as bag:
    dynamic, static = [
        bag.add_connection(topic, 'tf2_msgs/msg/TFMessage', typestore=TYPES, offered_qos_profiles=[
            dds.Qos(dds.QosHistory.KEEP_LAST, 100, dds.QosReliability.RELIABLE, durability,
                    INFINITE, INFINITE, dds.QosLiveliness.AUTOMATIC, INFINITE, False)])
        for topic, durability in (('/tf', dds.QosDurability.VOLATILE),
                                  ('/tf_static', dds.QosDurability.TRANSIENT_LOCAL))]

    def write(received: Received) -> None:
        """
        Write messages to the bag, unchanged, with the times of their arrival.

        :param received: the messages, and the number of messages that were dropped.
        """
        for message in received.messages:
            bag.write(static if message.is_static else dynamic, message.time, message)
        if received.dropped:
            node.get_logger().error(
                f'{received.dropped} messages arrived too fast and are not in the bag')

    stop = Event()  # set by the handlers, so that no signal interrupts a write
    for signal_number in signal.SIGINT, signal.SIGTERM:
        signal.signal(signal_number, lambda *_: stop.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('record')
    listener = PublisherListener(Buffer(node=node), node)
    node.get_logger().info('recording; press Ctrl-C to stop, which completes the bag')
    while not stop.is_set():
        rclpy.spin_once(node, timeout_sec=0.1)
        write(listener.received())
    listener.unregister()
    write(listener.received())  # messages that arrived after the last turn of the loop
    rclpy.shutdown()
print(f'{sys.argv[1]}: {sum(bag.counts.values())} messages')
