"""
The cost of messages that wait for their transforms: MessageFilter, and the same by hand.

    filtering.py send RATE SECONDS              publish messages, and their transforms 5 ms later
    filtering.py filter|future|subscription     print the used part of a core, and the number of
                                                messages that were passed on
"""

from collections import deque
from collections.abc import Callable, Iterator
import os
from pathlib import Path
import subprocess
import sys
import time

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', '97')

from geometry_msgs.msg import PointStamped
from measure import Row
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time

from puretf import Buffer, MessageFilter, TransformBroadcaster, TransformListener

TOPIC = 'points'
RATE, SECONDS = 1000, 10
#: The time from a message to its transform (ns).
DELAY = 5_000_000
#: The queue of DDS, and that of the filter.
DEPTH, QUEUE = 1000, 100


def send(rate: float, seconds: float) -> None:
    """Publish messages with increasing numbers, and their transforms later."""
    node = rclpy.create_node('sender')
    publisher = node.create_publisher(PointStamped, TOPIC, DEPTH)
    broadcaster = TransformBroadcaster(node)
    prepared = broadcaster.prepare([('map', 'odom'), ('odom', 'laser')])
    poses = np.tile([0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, 1))
    while not (publisher.get_subscription_count() and broadcaster.pub_tf.get_subscription_count()):
        time.sleep(0.01)
    time.sleep(0.5)  # until the subscriptions have found the publishers, too
    message, stamps = PointStamped(), deque[int]()
    message.header.frame_id = 'laser'
    begin, number, count = time.monotonic(), 0, int(rate * seconds)
    while number < count or stamps:
        if number < count and time.monotonic() >= begin + number / rate:
            stamp = time.time_ns()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
            message.point.x = float(number)
            publisher.publish(message)
            stamps.append(stamp)
            number += 1
        while stamps and time.time_ns() >= stamps[0] + DELAY:
            prepared.send(stamps.popleft(), poses)
        time.sleep(0.0002)
    print('sent', flush=True)
    time.sleep(5.0)  # DDS may have to send some messages again


def receive(kind: str, node: Node, callback: Callable[[PointStamped], None]) -> None:
    """Subscribe to the messages, and call a function with each of them."""
    buffer = Buffer(node=node)
    TransformListener(buffer, node)
    pending: set[Future] = set()

    def wait(message: PointStamped) -> None:
        def finish(future: Future) -> None:
            pending.discard(future)
            callback(message)

        future = buffer.wait_for_transform_async(
            'map', message.header.frame_id, Time.from_msg(message.header.stamp))
        pending.add(future)
        future.add_done_callback(finish)

    if kind == 'filter':
        MessageFilter((PointStamped, TOPIC, DEPTH), buffer, 'map', QUEUE, node
                      ).registerCallback(callback)
    else:
        node.create_subscription(
            PointStamped, TOPIC, wait if kind == 'future' else callback, DEPTH)


def cpu(kind: str) -> tuple[float, int]:
    """Receive all messages; return the CPU time per time, and the number of messages."""
    node = rclpy.create_node('receiver')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    times: list[tuple[float, float]] = []
    receive(kind, node, lambda _: times.append((time.monotonic(), time.process_time())))
    while not times or time.monotonic() < times[-1][0] + 2.0:
        executor.spin_once(timeout_sec=0.1)
    (begin, cpu_begin), (end, cpu_end) = times[0], times[-1]
    return (cpu_end - cpu_begin) / (end - begin), len(times)


def rows() -> Iterator[Row]:
    """Measure the CPU time of processes that receive messages over DDS."""
    kinds = {'subscription': 'subscription, without waiting for the transforms',
             'future': 'by hand: subscription, wait_for_transform_async, done callback',
             'filter': 'MessageFilter'}
    used = {}
    for kind, what in kinds.items():
        with play('send', str(RATE), str(SECONDS)) as sender, play(kind) as process:
            output = process.communicate(timeout=120)[0].split()
            sender.kill()
        used[kind] = float(output[0])
        compared = '' if kind == 'subscription' else f'{used[kind] / used["future"]:.2f} by hand'
        yield (f'{RATE} messages/s, transforms 5 ms late: {what}',
               f'{used[kind]:.1%} of a core', '',
               f'{output[1]} of {RATE * SECONDS} messages; {compared}'.removesuffix('; '))


def play(*arguments: str) -> 'subprocess.Popen[str]':
    """Start a process of this module."""
    return subprocess.Popen([sys.executable, str(Path(__file__)), *arguments],
                            stdout=subprocess.PIPE, text=True)


if __name__ == '__main__':
    if len(sys.argv) == 1:
        for row in rows():
            print(f'| {" | ".join(row)} |')
    else:
        rclpy.init()
        if sys.argv[1] == 'send':
            send(float(sys.argv[2]), float(sys.argv[3]))
        else:
            print(*cpu(sys.argv[1]), flush=True)
        rclpy.shutdown()
