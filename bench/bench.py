"""
Measure the speed and memory of this package, as ratios within one run.

The unit u is the time of `rclpy.serialization.deserialize_message` for one TransformStamped. Times
are the best of five runs. The script prints Markdown tables, one for each section of
docs/benchmarks.md, and draws how the cost of a lookup grows, into the file that is named on the
command line.
"""

from collections.abc import Iterable
import os
import sys

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_DOMAIN_ID', '97')

from geometry_msgs.msg import TransformStamped
import listening
import lookups
from measure import best, imports, Row
import numpy as np
import rclpy
from rclpy.serialization import deserialize_message, serialize_message
import reading
import sending
import viewing


def table(title: str, *parts: Iterable[Row]) -> None:
    """Print a table under a title, row by row."""
    print(f'\n## {title}\n\n| work | cost | u | compared |\n|---|---|---|---|')
    for rows in parts:
        for row in rows:
            print('| ' + ' | '.join(row) + ' |', flush=True)


def main() -> None:
    """Print the tables and draw the plot."""
    rclpy.init()
    data = serialize_message(sending.transforms(1)[0])
    u = best(lambda: deserialize_message(data, TransformStamped))
    print(f'Python {sys.version.split()[0]}, numpy {np.__version__}, {os.cpu_count()} cores; '
          f'u = {u * 1e6:.1f} µs')
    table('Listening', listening.over_dds())
    table('Looking up', lookups.rows(u), lookups.beside_rust())
    lookups.plot(sys.argv[1])
    table('Publishing', sending.rows(rclpy.create_node('bench'), u), sending.other_type(u),
          sending.ticking(rclpy.create_node('listener')))
    table('Bags', reading.rows(u), reading.many(u), reading.doctor())
    table('Memory', listening.memory(), reading.memory())
    table('One message at a time', listening.into_the_buffer(u))
    table('The web page', viewing.placing(), viewing.showing(), viewing.watching(),
          viewing.opening())
    table('Import', imports())
    rclpy.shutdown()


if __name__ == '__main__':
    main()
