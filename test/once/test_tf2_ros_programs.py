"""Programs in the style of the public tutorials, with tf2's names only; they run as they stand."""

import math
import re

from environment import ROOT
from geometry_msgs.msg import PointStamped
from processes import TIMEOUT
import pytest
from rclpy.duration import Duration
from rclpy.time import Time
from ros_node import point, stamped

from puretf import StaticTransformBroadcaster

PROGRAMS = ROOT / 'test' / 'support' / 'tf2_ros_programs'


@pytest.fixture
def run(start):
    """A function that starts a program."""
    return lambda name, *arguments: start(str(PROGRAMS / f'{name}.py'), *arguments)


@pytest.fixture
def lookup(listening):
    """A function that waits for a transform, and returns it."""
    return lambda target, source: listening.lookup_transform(
        target, source, Time(), Duration(seconds=TIMEOUT)).transform


def test_all_programs_use_the_names_of_tf2():
    """Each of the programs imports a package of tf2, and none imports this package."""
    programs = {path.stem: path.read_text() for path in PROGRAMS.rglob('*.py')}
    assert programs
    for code in programs.values():
        assert re.search(r'(?m)^(import|from) tf2?_', code)
        assert not re.search(r'(?m)^\s*(import|from) dummy_arm', code)


def test_static_broadcaster(run, lookup):
    """A listener that starts later receives the transform."""
    run('static_broadcaster', 'mystaticturtle', '0', '0', '1', '0', '0', str(math.pi / 2))
    pose = lookup('world', 'mystaticturtle')
    assert pose.translation.z == 1.0
    assert (pose.rotation.z, pose.rotation.w) == pytest.approx((0.5 ** 0.5, 0.5 ** 0.5))


def test_listener(run):
    """It reports what is missing, and follows the other turtle when both are there."""
    listener = run('listener')
    listener.line_with('Could not transform turtle2 to turtle1')
    run('static_broadcaster', 'turtle2', '0', '0', '0', '0', '0', '0')
    run('dynamic_broadcaster')
    listener.line_with('distance 2.000')


def test_point_transform(run, ros):
    """A point of a sensor is transformed in the callback that receives it."""
    process = run('point_transform')
    sensor = stamped('world', 'sensor', x=1.0)
    sensor.transform.rotation.z = sensor.transform.rotation.w = 0.5 ** 0.5
    StaticTransformBroadcaster(ros.node).sendTransform(sensor)
    publisher = ros.node.create_publisher(PointStamped, 'point', 10)

    def send():
        sent = point('sensor', ros.node.get_clock().now().nanoseconds)
        sent.point.x, sent.point.z = 2.0, 0.5
        publisher.publish(sent)

    ros.node.create_timer(0.1, send)
    ros.until(lambda: 'world: 1.000 2.000 0.500\n' in process.output)
    assert 'Traceback' not in process.output


@pytest.mark.parametrize('arguments', [('dummy_arm.py',), ('-m', 'dummy_arm')])
def test_the_program_of_the_course(start, lookup, arguments):
    """It is called dummy_arm.py; so does a program beside it find the package, not the program."""
    arm = start(*arguments, cwd=PROGRAMS / 'course')
    watch = start('watch.py', cwd=PROGRAMS / 'course')
    watch.line_with('joint_1 is 0.3 m above map')
    assert watch.exit_code() == 0
    assert lookup('map', 'joint_1').translation.z == pytest.approx(0.3)
    assert not arm.has_ended()
    assert 'Traceback' not in arm.output
