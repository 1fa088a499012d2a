"""
Record transforms until Ctrl-C, into a bag that `ros2 bag play` can play.

The topics are /tf, /tf_static, /robot_description and /joint_states.

Usage: record.py DIRECTORY
"""

from functools import partial
import signal
import sys
from threading import Event
from time import time_ns

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rosbags import interfaces as dds
from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from puretf import Buffer
from puretf.publisher_listener import PublisherListener, Received

INFINITE = dds.QosTime(9223372036, 854775807)
TYPES = get_typestore(Stores.ROS2_JAZZY)

VOLATILE, LATCHED = dds.QosDurability.VOLATILE, dds.QosDurability.TRANSIENT_LOCAL

with Writer(sys.argv[1], version=9, storage_plugin=StoragePlugin.MCAP) as bag:
    dynamic, static, description, joints = [
        bag.add_connection(topic, msgtype, typestore=TYPES, offered_qos_profiles=[
            dds.Qos(dds.QosHistory.KEEP_LAST, 100, dds.QosReliability.RELIABLE, durability,
                    INFINITE, INFINITE, dds.QosLiveliness.AUTOMATIC, INFINITE, False)])
        for topic, msgtype, durability in (
            ('/tf', 'tf2_msgs/msg/TFMessage', VOLATILE),
            ('/tf_static', 'tf2_msgs/msg/TFMessage', LATCHED),
            ('/robot_description', 'std_msgs/msg/String', LATCHED),
            ('/joint_states', 'sensor_msgs/msg/JointState', VOLATILE))]

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

    def write_other(connection: Connection, data: bytes) -> None:
        """Write a message of another topic to the bag."""
        bag.write(connection, time_ns(), data)

    stop = Event()  # set by the handlers, so that no signal interrupts a write
    for signal_number in signal.SIGINT, signal.SIGTERM:
        signal.signal(signal_number, lambda *_: stop.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('record')
    listener = PublisherListener(Buffer(node=node), node)
    for message_type, connection, durability in (
            (String, description, DurabilityPolicy.TRANSIENT_LOCAL),
            (JointState, joints, DurabilityPolicy.VOLATILE)):
        node.create_subscription(
            message_type, connection.topic,
            partial(write_other, connection),
            QoSProfile(depth=100, durability=durability), raw=True)
    node.get_logger().info('recording; press Ctrl-C to stop, which completes the bag')
    while not stop.is_set():
        rclpy.spin_once(node, timeout_sec=0.1)
        write(listener.received())
    listener.unregister()
    write(listener.received())  # messages that arrived after the last turn of the loop
    rclpy.shutdown()
print(f'{sys.argv[1]}: {sum(bag.counts.values())} messages')
