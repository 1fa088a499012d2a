"""The listener of the commands: what it says if nothing arrives on /tf."""

from itertools import chain, count
import time

from geometry_msgs.msg import TransformStamped
from ros_node import stamped
from rosgraph_msgs.msg import Clock

from puretf import StaticTransformBroadcaster, TransformBroadcaster
from puretf_tools.inspection.clock_sampler import ClockSampler
from puretf_tools.inspection.frame_listener import FrameListener
from puretf_tools.inspection.pulse import Pulse


def test_the_remedies(ros, make_node, monkeypatch):
    """Other topics are named, until something arrives here or can arrive."""
    monkeypatch.setattr('puretf.transform_listener._DISCOVERY', 0.0)
    listener = FrameListener(make_node('listener', namespace='/a', cli_args=[
        '--ros-args', '-r', '/tf:=/a/tf', '-r', '/tf_static:=/a/tf_static']))
    assert listener.topics == ['/a/tf_static', '/a/tf']
    assert listener.topics_hint() == ''
    for topic in '/tf', '/b/c/tf', '/tf_old':
        TransformBroadcaster(ros.node, tf_topic=topic)
    for topic in '/b/c/tf_static', '/d/tf_static':
        StaticTransformBroadcaster(ros.node, tf_static_topic=topic)
    hint = ('No transform has arrived on /a/tf, but transforms are published on /tf, /tf_old, '
            "/d/tf, /b/c/tf. To listen to /tf, pass tf_topic='/tf', tf_static_topic='/tf_static' "
            'to the TransformListener, or to a command: --ros-args -r /tf:=/tf '
            '-r /tf_static:=/tf_static. More: tf_doctor --explain namespace')
    ros.until(lambda: listener.topics_hint() == hint)
    assert listener.why_nothing() == hint
    publisher = TransformBroadcaster(ros.node, tf_topic='/a/tf').pub_tf
    ros.until(lambda: listener.topics_hint() == '')
    ros.until(lambda: 'Nothing has arrived yet from /test.' in listener.why_nothing())
    ros.node.destroy_publisher(publisher)
    ros.until(lambda: listener.topics_hint() == hint)
    listener.buffer.set_transform_static(stamped('map', 'camera'), 'test')
    assert listener.topics_hint() == ''  # a robot may have static transforms only


def test_nobody_is_blamed_before_discovery_has_had_its_time(ros):
    """Fast DDS announces itself every 3 s."""
    listener = FrameListener(ros.node)
    listener._start -= 3.0
    assert listener.why_nothing().startswith('The listener has just started; discovery can take ')
    listener._start -= 2.0
    assert listener.why_nothing().startswith('0 publishers on /tf and /tf_static were found in ')


def test_no_remedy_is_needed(ros):
    """Once a dynamic transform has been received, nothing is said about other topics."""
    listener = FrameListener(ros.node)
    TransformBroadcaster(ros.node, tf_topic='/robot1/tf')
    ros.until(listener.topics_hint)
    listener.buffer.set_transform_static(stamped('map', 'camera'), 'test')
    hint = listener.topics_hint()
    assert '/robot1/tf' in hint
    assert listener.why_no_transform('map', 'lidar').endswith(
        f"Known frames: 'camera', 'map'. {hint}")
    listener.buffer.set_transform(stamped('map', 'robot', 1), 'test')
    assert listener.topics_hint() == ''


def test_a_clock_that_has_sent_nothing_yet_does_not_stand(ros):
    """It may be about to."""
    sampler = ClockSampler(ros.node)
    ros.node.create_publisher(Clock, '/clock', 10)
    ros.until(sampler.nodes)
    assert sampler.stands() == 0.0


def test_stamps_of_the_system_clock_are_recognised_at_once(ros):
    """Also while somebody publishes /clock, as a simulation that is not used."""
    ros.node.create_publisher(Clock, '/clock', 10)
    listener = FrameListener(ros.node)
    ros.until(listener.clock_sampler.nodes)
    listener.buffer.set_transform(stamped('map', 'base', time.time_ns()), 'test')
    assert listener.knows_clock()
    assert not listener.clock.is_simulated


def test_another_type(ros, stranger):
    """The first publisher of another type is named; none counts as one of transforms."""
    listener = FrameListener(ros.node)
    for topic in '/tf_static', '/tf', '/tf':
        stranger.node.create_publisher(TransformStamped, topic, 10)
    text = ('/test publishes geometry_msgs/msg/TransformStamped on /tf_static, not '
            'tf2_msgs/msg/TFMessage. Send with a TransformBroadcaster or a '
            'StaticTransformBroadcaster. More: tf_doctor --explain missing_frame')
    ros.until(lambda: listener.topics_hint() == text)
    assert listener.why_nothing() == text
    assert listener.why_no_transform('map', 'camera').count(text) == 1


def test_another_type_beside_transforms(ros, stranger):
    """The cause of a missing frame is named where other frames exist."""
    listener = FrameListener(ros.node)
    stranger.node.create_publisher(TransformStamped, '/tf', 10)
    listener.buffer.set_transform(stamped('map', 'robot', 1), 'test')
    ros.until(listener.wrong_type_hint)
    assert 'on /tf, not tf2_msgs/msg/TFMessage.' in listener.why_no_transform('map', 'camera')
    assert not listener.why_no_transform('map', 'robot')


def test_how_late_the_program_runs(ros, make_node, monkeypatch):
    """A wake-up that comes 0.3 s late is noted, until the listener ends."""
    ms = 10**6
    times = chain([0, 50 * ms, 400 * ms], count(450 * ms, 50 * ms))
    monkeypatch.setattr('puretf_tools.inspection.pulse.monotonic_ns', lambda: next(times))
    listener = FrameListener(make_node('listener'))
    pulse: Pulse = listener.pulse
    ros.until(lambda: [late for _, late in pulse.late(60.0)] == [300 * ms])
    listener.unregister()
    ros.until(lambda: not pulse.is_alive())
