"""
The processes of `listening.py`: publishers, and the listeners that are measured.

    roles.py send tf|poses RATE FRAMES SECONDS    publish, from the first subscription on
    roles.py cpu LISTENER [unspun]                print the used part of a core
    roles.py count LISTENER                       print how many messages arrived, once none does
    roles.py latency LISTENER                     print the median time from publishing to use (s)

The node of a listener is spun, unless `unspun` is given.
"""

from contextlib import suppress
import os
import signal
import statistics
import sys
from threading import Thread
import time
from typing import Any, Protocol

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', '97')

from builtin_interfaces.msg import Time as Stamp
import numpy as np
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time
from visualization_msgs.msg import InteractiveMarkerPose, InteractiveMarkerUpdate

from puretf import Buffer, TFMessage, TransformBroadcaster, TransformListener

SECONDS = 4.0
LATENCIES = 500
#: The longest delay for which a publisher makes up (s).
LATE = 0.005


def send(topic: str, rate: float, frames: int, seconds: float) -> None:
    """
    Publish a chain of frames that wave, stamped with the time.

    :param topic: tf: as TFMessage; poses: the same fields, by a type that rclpy converts by
        compiled code.
    """
    node = rclpy.create_node('sender')
    edges = [(f'frame_{i}', f'frame_{i + 1}') for i in range(frames)]
    broadcaster = TransformBroadcaster(node)
    prepared = broadcaster.prepare(edges)
    update = InteractiveMarkerUpdate(poses=[InteractiveMarkerPose(name=edge[1]) for edge in edges])
    publisher = node.create_publisher(InteractiveMarkerUpdate, '/poses', 100)
    poses = np.tile([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0], (frames, 1))
    while not (broadcaster.pub_tf if topic == 'tf' else publisher).get_subscription_count():
        time.sleep(0.01)
    time.sleep(0.5)  # until the subscription has found the publisher, too
    due = time.monotonic()
    for number in range(int(rate * seconds)):
        half = 0.4 * np.sin(number / rate + np.arange(frames))
        poses[:, 5], poses[:, 6] = np.sin(half), np.cos(half)
        now = time.time_ns()
        if topic == 'tf':
            prepared.send(now, poses)
        else:
            stamp = Stamp(sec=now // 10**9, nanosec=now % 10**9)
            for edge, message, pose in zip(edges, update.poses, poses):
                message.header.frame_id, message.header.stamp = edge[0], stamp
                message.pose.orientation.z, message.pose.orientation.w = pose[5], pose[6]
            publisher.publish(update)
        # After a stall of the machine, publishing continues at the rate and ends later.
        due = max(due + 1.0 / rate, time.monotonic() - LATE)
        time.sleep(max(0.0, due - time.monotonic()))
    time.sleep(2.0)  # DDS may have to send some messages again


class Listener(Protocol):
    """An object that fills a buffer."""

    @property
    def buffer(self) -> Any:
        """The buffer that is filled."""


class Objects:
    """A subscription to objects of rclpy, whose transforms are set one by one, as in tf2_ros."""

    def __init__(self, buffer: Buffer, node: Node) -> None:
        self.buffer = buffer
        group = ReentrantCallbackGroup()
        node.create_subscription(TFMessage, '/tf', self.take, 100, callback_group=group)
        node.create_subscription(TFMessage, '/tf_static', self.take, 100, callback_group=group)

    def take(self, message: Any) -> None:
        """Set the transforms of a message."""
        for transform in message.transforms:
            self.buffer.set_transform(transform, 'default_authority')


class Compiled:
    """The same with a type that rclpy converts by compiled code, as it does that of tf2_msgs."""

    def __init__(self, buffer: Buffer, node: Node) -> None:
        self.buffer = buffer
        group = ReentrantCallbackGroup()
        node.create_subscription(
            InteractiveMarkerUpdate, '/poses', self.take, 100, callback_group=group)
        node.create_subscription(TFMessage, '/tf_static', self.take, 100, callback_group=group)

    def take(self, message: Any) -> None:
        """Insert the poses of a message."""
        for pose in message.poses:
            stamp, point, turn = pose.header.stamp, pose.pose.position, pose.pose.orientation
            self.buffer.insert(
                stamp.sec * 10**9 + stamp.nanosec, pose.header.frame_id, pose.name,
                (point.x, point.y, point.z, turn.x, turn.y, turn.z, turn.w))


class Waiting(TransformListener):
    """A TransformListener with a future that stays pending, so that it never pauses."""

    def __init__(self, buffer: Buffer, node: Node) -> None:
        super().__init__(buffer, node)
        self.future = buffer.wait_for_transform_async('frame_0', 'nowhere', Time())


def listener(name: str, node: Node, cache: Duration) -> Listener:
    """Create a listener."""
    if name == 'tf2_ros':
        import tf2_ros
        real: Listener = tf2_ros.TransformListener(tf2_ros.Buffer(cache, node), node)
        return real
    classes: dict[str, Any] = {
        'TransformListener': TransformListener, 'Waiting': Waiting, 'Objects': Objects,
        'Compiled': Compiled}
    made: Listener = classes[name](Buffer(cache, node), node)
    return made


def samples(buffer: Any) -> int:
    """Return the number of samples of frame_1."""
    return next((frame.length for frame in buffer.frames() if frame.name == 'frame_1'), 0)


def cpu(name: str, node: Node) -> float:
    """Measure the CPU time of this process per time."""
    filled = listener(name, node, Duration(seconds=2.0)).buffer
    while not filled.can_transform('frame_0', 'frame_1', Time()):
        time.sleep(0.01)
    time.sleep(2.5)  # so that samples expire
    begin, time_begin = time.process_time(), time.monotonic()
    time.sleep(SECONDS)
    return (time.process_time() - begin) / (time.monotonic() - time_begin)


def count(name: str, node: Node) -> int:
    """Count the messages that arrive, until a second passes without one."""
    buffer = listener(name, node, Duration(seconds=1000.0)).buffer
    before, last = -1, 0
    while before != last or not last:
        time.sleep(1.0)
        before, last = last, samples(buffer)
    return last


def latency(name: str, node: Node) -> float:
    """Measure the median time from publishing to the end of a lookup, or to a callback (s)."""
    times: list[float] = []
    if name == 'subscription':
        def take(message: Any) -> None:
            stamp = message.transforms[0].header.stamp
            times.append(time.time() - stamp.sec - stamp.nanosec / 1e9)

        node.create_subscription(TFMessage, '/tf', take, 100)
        while len(times) < LATENCIES:
            time.sleep(0.1)
    else:
        buffer = listener(name, node, Duration(seconds=2.0)).buffer
        while not buffer.can_transform('frame_0', 'frame_1', Time()):
            time.sleep(0.01)
        while len(times) < LATENCIES:
            last = buffer.get_latest_common_time('frame_0', 'frame_1').nanoseconds
            buffer.lookup_transform(
                'frame_0', 'frame_1', Time(nanoseconds=last + 1), Duration(seconds=10.0))
            newest = buffer.get_latest_common_time('frame_0', 'frame_1').nanoseconds
            times.append(time.time() - newest / 1e9)
    return statistics.median(times)


def spin(node: Node) -> None:
    """Spin a node until the shutdown."""
    with suppress(ExternalShutdownException):
        rclpy.spin(node)


def main(role: str, *arguments: str) -> None:
    """Run a role."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    if role == 'send':
        topic, *numbers = arguments
        rate, frames, seconds = map(float, numbers)
        send(topic, rate, int(frames), seconds)
    else:
        node = rclpy.create_node('listener')
        name, *unspun = arguments
        thread = Thread(target=spin, args=(node,))
        if not unspun:
            thread.start()
        print({'cpu': cpu, 'count': count, 'latency': latency}[role](name, node), flush=True)
    rclpy.shutdown()


if __name__ == '__main__':
    main(*sys.argv[1:])
