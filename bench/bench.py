"""
Measure what this package promises of speed and memory, as ratios within one run.

The unit u is what `rclpy.serialization.deserialize_message` of one TransformStamped takes. Times
are the best of five. Prints tables in Markdown, and draws how the cost of a lookup grows into the
file that is named on the command line.
"""

from collections.abc import Iterable
import os
import sys

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', '97')

from geometry_msgs.msg import TransformStamped
import hostile
import listening
import lookups
from measure import best, Row
import numpy as np
import rclpy
from rclpy.serialization import deserialize_message, serialize_message
import reading
import sending
import viewing


def table(rows: Iterable[Row]) -> None:
    """Print a table, row by row."""
    print('\n| work | cost | compared |\n|---|---|---|')
    for row in rows:
        print('| ' + ' | '.join(row) + ' |', flush=True)


def main() -> None:
    """Print the tables, draw the plot."""
    rclpy.init()
    data = serialize_message(sending.transforms(1)[0])
    u = best(lambda: deserialize_message(data, TransformStamped))
    print(f'Python {sys.version.split()[0]}, numpy {np.__version__}, {os.cpu_count()} cores; '
          f'u = {u * 1e6:.1f} µs')
    table(lookups.rows(u))
    lookups.plot(sys.argv[1])
    table(listening.into_the_buffer(u))
    table(listening.memory())
    table(listening.over_dds())
    table(reading.rows(u))
    table(reading.memory())
    table(hostile.rows())
    table(hostile.memory())
    table(viewing.placing())
    table(viewing.showing())
    table(sending.rows(rclpy.create_node('bench'), u))
    table(sending.other_type(u))
    table(sending.ticking(rclpy.create_node('listener')))
    rclpy.shutdown()


if __name__ == '__main__':
    main()
