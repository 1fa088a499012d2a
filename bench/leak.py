"""
Publish and take a million TFMessages as objects, and print the resident memory meanwhile.

The script ends after that number of messages.
"""

import os
import sys

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', '97')

from measure import resident
import rclpy

from puretf import TFMessage, Transform


def main(count: int = 1_000_000) -> None:
    """Print a Markdown table: the messages so far, and the resident memory."""
    rclpy.init()
    node = rclpy.create_node('leak')
    taken = 0
    subscription = node.create_subscription(TFMessage, '/tf', lambda _: None, 10)
    publisher = node.create_publisher(TFMessage, '/tf', 10)
    message = TFMessage(transforms=[
        Transform(1_000_000_002, 'map', f'frame_{i}').to_message()
        for i in range(2)])
    print('| published | taken | resident (MiB) |\n|---|---|---|')
    for published in range(count + 1):
        if published % (count // 10) == 0:
            print(f'| {published} | {taken} | {resident():.1f} |', flush=True)
        publisher.publish(message)
        with subscription.handle:
            taken += subscription.handle.take_message(TFMessage, False) is not None
    rclpy.shutdown()


if __name__ == '__main__':
    main(*map(int, sys.argv[1:]))
