"""Errors of arguments of a wrong type or unit: they name the remedy, which works."""

from datetime import timedelta
import re
from typing import Any

from geometry_msgs.msg import (
    Point,
    PointStamped,
    Pose,
    PoseStamped,
    Quaternion,
    QuaternionStamped,
    TransformStamped,
    Vector3,
)
from nav_msgs.msg import Odometry, Path
import numpy as np
import pytest
import rclpy
from rclpy.clock import Clock
from rclpy.duration import Duration
from rclpy.time import Time
from ros_node import stamped

from puretf import (
    Buffer,
    BufferCore,
    ExtrapolationException,
    geometry,
    MessageFilter,
    StaticTransformBroadcaster,
    StaticTransformListener,
    TFMessage,
    Transform,
    TransformBroadcaster,
    TransformBuffer,
    TransformException,
    TransformListener,
    TypeException,
)

#: 100 s, in ns.
T = 100 * 10**9
DURATION = Duration(seconds=2)
NOTE = (' The time is a Duration. Pass a Duration as timeout=. More: tf_doctor --explain other')


@pytest.fixture
def buffer():
    """A buffer with map -> tool at 100 s."""
    made = Buffer()
    made.set_transform(stamped('map', 'tool', T), 'test')
    return made


def error_of(kind, call, *args, **kwargs):
    """Return the text of the error that a call raises: one line without a long repr."""
    with pytest.raises(kind) as raised:
        call(*args, **kwargs)
    text = str(raised.value)
    assert '\n' not in text
    assert len(text) < 500
    return text


def remedy_of(text):
    """Return the expression that an error tells to write."""
    return text.rpartition(': write ')[2]


# A Duration as the time


@pytest.mark.parametrize('duration', [DURATION, DURATION.to_msg()])
@pytest.mark.parametrize('name', ['lookup_transform', 'lookup_transform_core'])
def test_a_duration_as_the_time(buffer, name, duration):
    """It is the cause, and no clock is."""
    text = error_of(ExtrapolationException, getattr(buffer, name), 'map', 'tool', duration)
    assert text.startswith(
        'Lookup would require extrapolation at time 2.000000, but only time 100.000000 is in the ')
    assert text.endswith(NOTE)


def test_a_duration_as_the_time_of_can_transform(buffer):
    """The cause is in the debug tuple."""
    for answer in (buffer.can_transform('map', 'tool', DURATION, return_debug_tuple=True),
                   buffer.can_transform_core('map', 'tool', DURATION),
                   buffer.can_transform_full('map', DURATION, 'tool', DURATION, 'x',
                                             return_debug_tuple=True),
                   buffer.can_transform_full_core('map', DURATION, 'tool', DURATION, 'x')):
        assert answer[0] is False
        assert NOTE in answer[1]


def test_a_duration_as_the_time_that_tf2_accepts(buffer):
    """As in tf2, it is a time."""
    assert buffer.lookup_transform('map', 'tool', Duration(seconds=100)) == stamped(
        'map', 'tool', T)
    assert buffer.can_transform('map', 'tool', Duration(), return_debug_tuple=True) == (True, '')


# Numbers as times and durations


@pytest.mark.parametrize(('number', 'remedy'), [
    (1.5, 'Time(seconds=1.5)'), (5, 'Time(seconds=5)'), (1_700_000_000.25,
                                                          'Time(seconds=1700000000.25)'),
    (T * 10**7, 'Time(nanoseconds=1000000000000000000)'), (
        1e18, f'Time(nanoseconds={10**18})'),
    (np.datetime64(5, 's'), 'Time(nanoseconds=5000000000)'),
    (np.float32(0.5), 'Time(seconds=0.5)'), (np.int64(3), 'Time(seconds=3)')])
def test_a_number_as_the_time(buffer, number, remedy):
    """It is meant as seconds or, if it is too large, as nanoseconds."""
    text = error_of(TypeError, buffer.lookup_transform, 'map', 'tool', number)
    assert text.startswith('time must have sec and nanosec, or nanoseconds. Got ')
    assert remedy_of(text) == remedy
    with pytest.raises(TransformException):
        buffer.lookup_transform('map', 'tool', eval(remedy))


@pytest.mark.parametrize(('value', 'remedy'), [
    (1.0, 'Duration(seconds=1.0)'), (2, 'Duration(seconds=2)'),
    (timedelta(milliseconds=20), 'Duration(seconds=0.02)'),
    (np.timedelta64(3, 's'), 'Duration(nanoseconds=3000000000)'),
    (np.float64(0.25), 'Duration(seconds=0.25)'), (5 * 10**9, 'Duration(nanoseconds=5000000000)')])
def test_a_number_as_a_duration(buffer, value, remedy):
    """Every argument that must be a Duration says how to write it."""
    for argument, call in (
            ('timeout', lambda it: buffer.lookup_transform('map', 'tool', Time(), timeout=it)),
            ('timeout', lambda it: buffer.lookup_transform_full(
                'map', Time(), 'tool', Time(), 'map', it)),
            ('timeout', lambda it: buffer.can_transform('map', 'tool', Time(), it)),
            ('timeout', lambda it: buffer.wait_for_transform_async('map', 'tool', Time(), it)),
            ('cache_time', lambda it: Buffer(cache_time=it)), ('cache_time', BufferCore)):
        text = error_of(TypeError, call, value)
        assert text.startswith(f'{argument} must have sec and nanosec, or nanoseconds. Got ')
        assert remedy_of(text) == remedy
        call(eval(remedy))


@pytest.mark.parametrize('value', [
    None, 'soon', float('nan'), True, -1.0, *np.array(['NaT', '9999-01-01'], 'datetime64[s]')])
def test_other_values_have_no_remedy(buffer, value):
    """What was meant is not known."""
    text = error_of(TypeError, Buffer().lookup_transform, 'a', 'b', Time(), value)
    assert ' write ' not in text


@pytest.mark.parametrize('argument', ['tolerance', 'buffer_timeout'])
def test_a_number_as_a_duration_of_a_filter(ros, argument):
    """It also takes integers (ns)."""
    def create(value):
        MessageFilter(None, Buffer(), 'map', 1, ros.node, **{argument: value}).unregister()

    text, remedy = error_of(TypeError, create, 0.5), f'round({argument} * 1e9)'
    assert text == (
        f'{argument} must be an integer (ns), or a time or duration of numpy or ROS, got 0.5 of '
        f'type float: write int({argument}) if it is in ns, {remedy} if it is in s')
    create(Duration(seconds=0.5))
    create(eval(remedy, {argument: 0.5}))


# Fields of messages


@pytest.mark.parametrize(('path', 'value', 'remedy'), [
    ('header.stamp', Clock().now(), '.to_msg() after it'),
    ('header.stamp', Time(seconds=5), '.to_msg() after it'),
    ('header.stamp', DURATION, 'clock.now().to_msg()'),
    ('header.stamp', None, 'clock.now().to_msg()'),
    ('header.stamp', 2.5, 'rclpy.time.Time(seconds=2.5).to_msg(), or clock.now().to_msg()'),
    ('header.stamp', 3, 'rclpy.time.Time(seconds=3).to_msg(), or clock.now().to_msg()'),
    ('header.stamp', 17 * 10**17,
     'rclpy.time.Time(nanoseconds=1700000000000000000).to_msg(), or clock.now().to_msg()'),
    ('header.stamp.sec', 2.5, 'header.stamp = rclpy.time.Time(seconds=2.5).to_msg()'),
    ('header.stamp.nanosec', 17 * 10**17,
     'header.stamp = rclpy.time.Time(nanoseconds=1700000000000000000).to_msg()'),
    ('transform.translation', np.zeros(3), 'Vector3(x=x, y=y, z=z)'),
    ('transform.translation', [1.0, 2.0, 3.0], 'Vector3(x=x, y=y, z=z)'),
    ('transform.rotation', (0.0, 0.0, 0.0, 1.0), 'Quaternion(x=x, y=y, z=z, w=w)'),
    ('transform.rotation', np.zeros((1000, 4)), 'Quaternion(x=x, y=y, z=z, w=w)'),
    ('transform.rotation.w', 'one', '')])
def test_a_field_of_a_wrong_type(ros, path, value, remedy):
    """The remedy makes a message that can be sent and set."""
    def set_field(to):
        message = stamped('map', 'tool', T)
        *parts, name = path.split('.')
        target: Any = message
        for part in parts:
            target = getattr(target, part)
        setattr(target, name, to)
        return message

    broadcaster = TransformBroadcaster(ros.node)
    for each in broadcaster, StaticTransformBroadcaster(ros.node):
        text = error_of(ValueError, each.sendTransform, set_field(value))
        assert f"to child 'tool': {path} must be " in text
        assert remedy_of(text) == (remedy or text)
    if not remedy:
        return
    names = {'clock': Clock(), 'rclpy': rclpy, 'Vector3': Vector3, 'Quaternion': Quaternion,
             **dict.fromkeys('xyzw', 0.5)}
    expression = remedy.removeprefix('header.stamp = ').replace(
        '.to_msg() after it', 'value.to_msg()')
    if remedy.startswith('header.stamp = '):
        path = 'header.stamp'
    for each in expression.split(', or '):
        mended = set_field(eval(each, names, {'value': value}))
        broadcaster.sendTransform(mended)
        Buffer().set_transform(mended, 'test')


# Things that are no transform


def rosbags_message(name, *args):
    """Return a message of rosbags."""
    from rosbags.typesys import get_typestore, Stores
    types = get_typestore(Stores.ROS2_JAZZY).types
    header = types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](5, 6), 'map')
    vector = types['geometry_msgs/msg/Vector3'](1.0, 2.0, 3.0)
    rotation = types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0)
    return types[f'geometry_msgs/msg/{name}'](*{
        'TransformStamped': (header, 'tool', types['geometry_msgs/msg/Transform'](
            vector, rotation)),
        'PointStamped': (header, types['geometry_msgs/msg/Point'](1.0, 2.0, 3.0))}[name])


def test_a_transform_of_rosbags(ros, buffer):
    """It is named without its repr; it can be converted."""
    pytest.importorskip('rosbags')
    message = rosbags_message('TransformStamped')
    for call in (buffer.set_transform_static, TransformBroadcaster(ros.node).sendTransform,
                 StaticTransformBroadcaster(ros.node).sendTransform):
        assert error_of(TypeError, call, message) == (
            'expected a TransformStamped, got a message geometry_msgs/msg/TransformStamped of '
            'rosbags: read the bag by puretf.bag.read, or insert '
            'Transform.from_message(message) into a TransformBuffer')
    without_ros = TransformBuffer()
    assert error_of(TypeError, without_ros.set_transform, message).endswith(
        'got a message geometry_msgs/msg/TransformStamped of rosbags: write '
        'Transform.from_message() around it')
    without_ros.set_transform(Transform.from_message(message))
    assert without_ros.lookup_transform('map', 'tool').translation == (1.0, 2.0, 3.0)


def test_data_of_rosbags(buffer):
    """Neither data nor a transform of rosbags is transformed into a message of ROS."""
    pytest.importorskip('rosbags')
    point = rosbags_message('PointStamped')
    assert error_of(TypeException, buffer.transform, point, 'map').endswith(
        'is not loaded or supported: it is a message of rosbags; create the message of ROS with '
        'these fields')
    assert 'got a message geometry_msgs/msg/PointStamped of rosbags and a Tr' in error_of(
        AttributeError, geometry.do_transform_pose, point, TransformStamped())
    assert error_of(TypeError, geometry.do_transform_point, PointStamped(),
                    rosbags_message('TransformStamped')).startswith(
        'expected a TransformStamped, got a message geometry_msgs/msg/TransformStamped of rosbags')


@pytest.mark.parametrize(('given', 'end'), [
    (Transform(0, 'map', 'tool'), 'of type Transform: a TransformBuffer takes Transforms'),
    (TFMessage(transforms=[stamped('map', 'tool', T)]), ': pass each of its transforms'),
    ([[stamped('map', 'tool', T)]], 'of type list: pass each of its transforms'),
    (PoseStamped(), 'of type PoseStamped')])
def test_what_is_sent_is_no_transform(ros, given, end):
    """The text is short, and names what may have been meant."""
    text = error_of(TypeError, TransformBroadcaster(ros.node).sendTransform, given)
    assert text.startswith('expected a TransformStamped, got ')
    assert text.endswith(end)


# The order of arguments


def test_the_order_of_arguments(ros, buffer):
    """The error has the right call."""
    node = ros.node
    for call, right in (
            (lambda: Buffer(node), 'Buffer(node=node)'),
            (lambda: Buffer(Duration(seconds=1), buffer), 'Buffer(node=node)'),
            (lambda: TransformListener(node, buffer), 'TransformListener(buffer, node)'),
            (lambda: StaticTransformListener(node, buffer),
             'StaticTransformListener(buffer, node)'),
            (lambda: TransformListener(buffer, None),  # type: ignore[arg-type]
             'TransformListener(buffer, node)'),
            (lambda: TransformBroadcaster(buffer), 'TransformBroadcaster(node)'),
            (lambda: StaticTransformBroadcaster(buffer), 'StaticTransformBroadcaster(node)'),
            (lambda: MessageFilter(None, node, 'map', 1, buffer),
             'MessageFilter(input, buffer, target_frames, queue_size, node)')):
        text = error_of(TypeError, call)
        assert re.match(r'(node|cache_time) must be a ', text)
        assert remedy_of(text) == right
        names: dict[str, Any] = {**globals(), 'node': node, 'buffer': buffer, 'input': None,
                                 'target_frames': 'map', 'queue_size': 1}
        made = eval(right, names)
        if hasattr(made, 'unregister'):
            made.unregister()


# The functions of geometry


def test_a_type_that_no_function_transforms(buffer):
    """Those that have one follow tf2's words."""
    assert error_of(TypeException, buffer.transform, Pose(), 'map') == (
        "Type <class 'geometry_msgs.msg._pose.Pose'> is not loaded or supported. The types with a "
        'function: Odometry, Path, PointCloud2, PointStamped, PolygonStamped, PoseArray, '
        'PoseStamped, PoseWithCovarianceStamped, QuaternionStamped, Vector3Stamped, '
        'WrenchStamped')


@pytest.mark.parametrize(('name', 'given', 'end'), [
    ('pose', PoseStamped(), 'got a PoseStamped and a TransformStamped: use '
     'do_transform_pose_stamped'),
    ('pose_array', Path(poses=[PoseStamped()]), ': use do_transform_path'),
    ('wrench_stamped', QuaternionStamped(), ': use do_transform_quaternion_stamped'),
    ('polygon_stamped', Odometry(), ': use do_transform_odometry'),
    ('point', Point(), 'takes a PointStamped and a TransformStamped, got a Point and a '
     'TransformStamped')])
def test_data_of_another_type(name, given, end):
    """The function of its type is named, after the words of tf2_geometry_msgs."""
    text = error_of(AttributeError, getattr(geometry, f'do_transform_{name}'), given,
                    TransformStamped())
    assert text.startswith("'")
    assert ' object has no attribute ' in text
    assert text.endswith(end)
    if ': use ' in text:
        function = getattr(geometry, text.rpartition(': use ')[2])
        assert type(function(given, TransformStamped())) is type(given)
    with pytest.raises(AttributeError, match=r'got a TransformStamped and a \w+$'):
        geometry.do_transform_point(TransformStamped(), given)
