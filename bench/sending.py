"""The cost of publishing transforms."""

from collections.abc import Iterator
from pathlib import Path
import re
import subprocess
import sys
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, Quaternion, Transform, TransformStamped, Vector3
from measure import best, cost, cpu_seconds, has_real_tf2, Row
from nav_msgs.msg import Path as NavPath
import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Header

from puretf import TFMessage, TransformBroadcaster

TICKS = 10_000
ARM = (sys.executable, '-c', 'from dummy_arm.entry_points import dummy_arm; dummy_arm()')


def transforms(count: int) -> list[TransformStamped]:
    """Return a chain of transforms, built by their constructors."""
    return [TransformStamped(
        header=Header(stamp=Time(sec=1_700_000_000, nanosec=123), frame_id=f'frame_{i}'),
        child_frame_id=f'frame_{i + 1}',
        transform=Transform(translation=Vector3(x=0.1, y=0.2, z=0.3),
                            rotation=Quaternion(x=0.0, y=0.0, z=0.6, w=0.8)))
            for i in range(count)]


def poses_of(built: list[TransformStamped]) -> NavPath:
    """Return the same as poses, in a message that rclpy converts by compiled code."""
    path = NavPath()
    for transform in built:
        pose = PoseStamped(header=transform.header)
        pose.pose.position.x = transform.transform.translation.x
        pose.pose.orientation = transform.transform.rotation
        path.poses.append(pose)
    return path


def rows(node: Node, u: float) -> Iterator[Row]:
    """Measure the publishing of 4, 100 and 1000 transforms."""
    broadcaster = TransformBroadcaster(node)
    real: Any = None
    if has_real_tf2():
        import tf2_ros
        real = tf2_ros.TransformBroadcaster(node)
    paths = node.create_publisher(NavPath, '/path', 100)
    is_real = TFMessage.__module__.startswith('tf2_msgs')
    for count in (4, 100, 1000):
        built = transforms(count)
        message, path = TFMessage(transforms=built), poses_of(built)
        prepared = broadcaster.prepare([(t.header.frame_id, t.child_frame_id) for t in built])
        poses = np.tile([0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8], (count, 1))
        rclpy_time = best(lambda: paths.publish(path))  # noqa: B023
        works = [
            ('prepare once, then send', lambda: prepared.send(1, poses)),  # noqa: B023
            ('sendTransform of built objects',
             lambda: broadcaster.sendTransform(built)),  # noqa: B023
            (f'publish(TFMessage), {"tf2_msgs" if is_real else "this package"}',
             lambda: broadcaster.pub_tf.publish(message))]  # noqa: B023
        if real is not None:
            works.append(('tf2_ros sendTransform', lambda: real.sendTransform(built)))  # noqa: B023
        for name, work in works:
            seconds = best(work)
            yield (f'{name}, {count} transforms', *cost(seconds, u),
                   f'{seconds / rclpy_time:.2f} of rclpy')
        building = best(lambda: transforms(count))  # noqa: B023
        yield f'building these objects, {count} transforms', *cost(building, u), ''
        yield (f'rclpy: publish(Path) of {count} poses, compiled conversion',
               *cost(rclpy_time, u), '1')


#: Publish a message of another type by rclpy's own method and by that of the package, in turn,
#: and print the time of each (s).
OTHER_TYPE = """
from measure import best
import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from std_msgs.msg import String
rclpy.init()
publisher = rclpy.create_node('other').create_publisher(String, 'text', 1)
own = _rclpy.Publisher.publish
import puretf.transform_broadcaster
ways = own, _rclpy.Publisher.publish
times = [], []
for _ in range(5):
    for way, taken in zip(ways, times):
        _rclpy.Publisher.publish = way
        taken.append(best(lambda: publisher.publish(String(data='hello'))))
print(*map(min, times))
rclpy.shutdown()
"""


def other_type(u: float) -> Iterator[Row]:
    """Measure what another type costs in addition, where TFMessage is made at run time."""
    printed = subprocess.run([sys.executable, '-c', OTHER_TYPE], check=True, text=True,
                             stdout=subprocess.PIPE, cwd=Path(__file__).parent).stdout
    own, ours = map(float, printed.split())
    yield "publish(String), rclpy's own", *cost(own, u), '1'
    yield ('publish(String), if TFMessage is made at run time', *cost(ours, u),
           f'{ours / own:.2f} of rclpy, {(ours - own) * 1e6:+.2f} µs')


def ticking(node: Node) -> Iterator[Row]:
    """Count the ticks that the arm keeps at 1000 Hz, as another process receives them."""
    stamps: list[int] = []

    def take(data: bytes) -> None:
        stamps.append(int.from_bytes(data[8:12], 'little') * 10**9
                      + int.from_bytes(data[12:16], 'little'))

    node.create_subscription(TFMessage, '/tf', take, 1000, raw=True)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with subprocess.Popen([*ARM, '--ros-args', '-p', 'rate:=1000'],
                          stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert re.search('t = 0', process.stderr.readline())
        while len(stamps) < TICKS and process.poll() is None:
            executor.spin_once(timeout_sec=1.0)
        cpu = cpu_seconds(process.pid)
        process.terminate()
    seconds = (stamps[-1] - stamps[0]) / 1e9
    due = round(seconds * 1000) + 1
    yield (f'dummy_arm at 1000 Hz for {seconds:.1f} s',
           f'{len(set(stamps)) / due:.2%} of ticks', '',
           f'{cpu / seconds:.0%} of a core')
