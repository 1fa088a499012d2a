"""TFMessage: the class of tf2_msgs, or the one that is created at run time."""

import copy
import importlib.util
import os
import pickle
import sys
from unittest.mock import patch

from environment import made_at_run_time
from geometry_msgs import msg
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from messages import golden_messages
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header
from type_description_interfaces.srv import GetTypeDescription

from puretf import TFMessage

HASH = 'RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087'


def message(case):
    """Return the message of a golden case."""
    transforms = []
    for each in case['transforms']:
        made = TransformStamped(child_frame_id=each['child_frame_id'])
        made.header.frame_id = each['frame_id']
        made.header.stamp.sec, made.header.stamp.nanosec = each['sec'], each['nanosec']
        made.transform = Transform(
            translation=Vector3(**dict(zip('xyz', each['xyz']))),
            rotation=Quaternion(**dict(zip('xyzw', each['xyzw']))))
        transforms.append(made)
    return TFMessage(transforms=transforms)


def longest_golden_message():
    """Return the bytes of the golden message that has the most of them."""
    return bytes.fromhex(max((case['cdr_hex'] for case in golden_messages()), key=len))


# The class, and its bytes


def test_it_is_a_message_class():
    """Fields, equality, repr and copies work as those of a generated class."""
    transform = TransformStamped(child_frame_id='a')
    full, empty = TFMessage(transforms=[transform]), TFMessage()
    assert TFMessage.get_fields_and_field_types() == {
        'transforms': 'sequence<geometry_msgs/TransformStamped>'}
    (slot_type,) = TFMessage.SLOT_TYPES
    assert slot_type.value_type.namespaced_name() == ('geometry_msgs', 'msg', 'TransformStamped')
    assert full == TFMessage(transforms=[TransformStamped(child_frame_id='a')])
    assert full != empty
    assert full != [transform]
    assert repr(full) == f'tf2_msgs.msg.TFMessage(transforms=[{transform!r}])'
    assert empty.transforms == []
    for duplicate in (copy.copy(full), copy.deepcopy(full), pickle.loads(pickle.dumps(full))):
        assert duplicate == full


@made_at_run_time
def test_fields_are_checked_on_request():
    """With check_fields, wrong values raise AssertionError, as in generated classes."""
    checked = TFMessage(check_fields=True)
    for wrong in ([42], 'map', None, 7):
        with pytest.raises(AssertionError, match="'transforms' field"):
            checked.transforms = wrong
    with pytest.raises(AssertionError, match='Invalid arguments passed to constructor: frames'):
        TFMessage(check_fields=True, frames=[])
    checked.transforms = [TransformStamped()]
    assert checked.transforms == [TransformStamped()]


@made_at_run_time
def test_it_is_serialized_as_by_tf2_msgs():
    """The bytes equal the golden ones, whose alignment padding is zero."""
    for case in golden_messages():
        assert serialize_message(message(case)).hex() == case['cdr_hex']


def test_it_is_deserialized_as_by_tf2_msgs():
    """The golden bytes give the golden transforms."""
    for case in golden_messages():
        assert deserialize_message(bytes.fromhex(case['cdr_hex']), TFMessage) == message(case)


@pytest.mark.parametrize('data', ['text', bytearray(8), None, 7])
@made_at_run_time
def test_only_bytes_are_deserialized(data):
    """Any other type raises TypeError, which names the expected type."""
    with pytest.raises(TypeError, match='expected bytes, got'):
        deserialize_message(data, TFMessage)


# Topics


def connected(ros, topic, depth=10):
    """Return a publisher, and a list that gets the messages of a subscription to it."""
    received: list[TFMessage] = []
    ros.node.create_subscription(TFMessage, topic, received.append, depth)
    publisher = ros.node.create_publisher(TFMessage, topic, depth)
    ros.until(lambda: publisher.get_subscription_count() == 1)
    return publisher, received


def test_objects_and_bytes_both_ways(ros):
    """A message is published as an object or as bytes, and received as either."""
    raw: list[bytes] = []
    with_info = []
    publisher, objects = connected(ros, '/tf')
    ros.node.create_subscription(TFMessage, '/tf', raw.append, 10, raw=True)
    ros.node.create_subscription(
        TFMessage, '/tf', lambda message, info: with_info.append((message, info)), 10)
    ros.until(lambda: publisher.get_subscription_count() == 3)
    sent = message(golden_messages()[-1])
    publisher.publish(sent)
    ros.until(lambda: objects and raw and with_info)
    assert objects[0] == sent
    assert with_info[0][0] == sent
    assert with_info[0][1]['source_timestamp'] > 0
    publisher.publish(raw[0])
    ros.until(lambda: len(objects) == 2)
    assert objects[1] == sent


@made_at_run_time
def test_malformed_messages_are_dropped(ros, capfd):
    """A subscriber drops each prefix of a message, logs it once, and takes the next good one."""
    publisher, received = connected(ros, '/tf_of_strangers', depth=1000)
    data, good = longest_golden_message(), TFMessage(transforms=[TransformStamped()])
    billion = data[:4] + (10**9).to_bytes(4, 'little') + data[8:]
    for number, bad in enumerate((*(data[:end] for end in range(4, len(data))), billion)):
        publisher.publish(bad)
        if number % 100 == 0:
            publisher.publish(good)
            ros.until(lambda: len(received) == number // 100 + 1)  # noqa: B023
    publisher.publish(data)
    ros.until(lambda: deserialize_message(data, TFMessage) in received)
    assert received[:-1] == [good] * (len(received) - 1)
    assert capfd.readouterr().err.count('dropped a message on /tf_of_strangers') == 1


@made_at_run_time
@pytest.mark.parametrize('wrong', [
    42, None, Transform(), TransformStamped(header=None), TransformStamped(transform=None),
    TransformStamped(header=Header(stamp=None)), TransformStamped(child_frame_id='\ud800')])
def test_a_wrong_element_sends_nothing(ros, wrong):
    """`publish` raises an exception, and the next message is the first that arrives."""
    publisher, received = connected(ros, '/tf')
    with pytest.raises((TypeError, ValueError)):
        publisher.publish(TFMessage(transforms=[TransformStamped(), wrong]))
    with pytest.raises(TypeError):
        publisher.publish(TransformStamped())
    good = TFMessage(transforms=[TransformStamped(child_frame_id='b')])
    publisher.publish(good)
    ros.until(lambda: received)
    assert received == [good]


THREADS = """
import threading, time
import rclpy
from puretf import TFMessage, TransformBroadcaster
from geometry_msgs.msg import TransformStamped
from rclpy.executors import MultiThreadedExecutor
rclpy.init()
node = rclpy.create_node('threads')
transform = TransformStamped(child_frame_id='b')
transform.header.frame_id = 'a'
message = TFMessage(transforms=[transform] * 20)
publisher = node.create_publisher(TFMessage, '/tf', 10)
broadcaster = TransformBroadcaster(node)
taken = threading.Event()
node.create_subscription(TFMessage, '/tf', lambda _: taken.set(), 10)
executor = MultiThreadedExecutor(2)
executor.add_node(node)
spinner = threading.Thread(target=executor.spin)
spinner.start()
def work(publish, argument):
    for _ in range(1500):
        publish(argument)
threads = [threading.Thread(target=work, args=arguments) for arguments in (
    (publisher.publish, message), (publisher.publish, message),
    (broadcaster.sendTransform, message.transforms))]
for thread in threads:
    thread.start()
for _ in range(5):
    node.destroy_publisher(node.create_publisher(TFMessage, '/tf', 10))
for thread in threads:
    thread.join()
taken.wait()
rclpy.shutdown()
spinner.join()
print('done')
"""


def test_threads_do_not_block_each_other(start):
    """Three threads publish while others take messages and create publishers: no deadlock."""
    process = start('-X', 'faulthandler', '-c', THREADS)
    assert process.line_with('done')
    assert process.exit_code() == 0


# The type


def test_its_name_and_hash_are_those_of_tf2_msgs(ros):
    """Other nodes see the type of tf2_msgs on a topic."""
    ros.node.create_publisher(TFMessage, '/tf', 10)
    (info,) = ros.node.get_publishers_info_by_topic('/tf')
    assert info.topic_type == 'tf2_msgs/msg/TFMessage'
    assert str(info.topic_type_hash) == HASH


def test_the_type_description_service_answers(ros):
    """The type description service of the node answers a request with the name and hash."""
    ros.node.create_publisher(TFMessage, '/tf', 10)
    client = ros.node.create_client(GetTypeDescription, '/test/get_type_description')
    ros.until(client.service_is_ready)
    future = client.call_async(GetTypeDescription.Request(
        type_name='tf2_msgs/msg/TFMessage', type_hash=HASH, include_type_sources=True))
    ros.until(future.done)
    answer = future.result()
    assert answer.successful, answer.failure_reason
    found = answer.type_description.type_description
    assert found.type_name == 'tf2_msgs/msg/TFMessage'


def imported_anew(name):
    """Import a module again, apart from the one that is in use."""
    spec = importlib.util.find_spec(name)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@made_at_run_time
@pytest.mark.parametrize(('name', 'error'), [
    ('Polygon', r"expected .*, found \(b'geometry_msgs__msg', b'Point32', 3, 12\)"),
    ('TransformStamped',
     "the hash of TransformStamped is not as in ROS 2 Jazzy and Kilted: expected '0a24")])
def test_a_mismatch_is_an_import_error(monkeypatch, name, error):
    """If geometry_msgs is not that of Jazzy, the error says what was expected and found."""
    monkeypatch.setattr(msg, name, msg.Point32)
    with pytest.raises(ImportError, match=error):
        imported_anew('puretf._tf2_msgs.type_support')


@made_at_run_time
def test_a_command_names_the_package_that_is_missing(start):
    """With an rclpy that was not read, no message is made at run time."""
    process = start('-c', 'import sys\nfrom puretf._text import distribution\n'
                    "distribution.rclpy_version = lambda: '10.0.9'\n"
                    'from puretf_tools.entry_points import view_frames\nsys.exit(view_frames())')
    assert process.exit_code() == 1
    assert process.output == (
        'view_frames: cannot create tf2_msgs/msg/TFMessage without tf2_msgs, because the release '
        "of rclpy is not as in ROS 2 Jazzy and Kilted: expected '7 or 9', found '10.0.9'; install "
        f'ros-{os.environ.get("ROS_DISTRO", "jazzy")}-tf2-msgs by apt or conda\n')


def test_the_real_one_is_used_where_it_is(monkeypatch, tmp_path):
    """If the tf2_msgs of ROS can be imported, puretf exports its class."""
    package = tmp_path / 'tf2_msgs'
    package.mkdir()
    for name in '__init__.py', 'tf2_msgs_s__rosidl_typesupport_c.so':
        (package / name).touch()
    (package / 'msg.py').write_text('class TFMessage:\n    """Stands for the real one."""\n')
    (package / 'srv.py').write_text('FrameGraph = 42\n')
    monkeypatch.syspath_prepend(tmp_path)
    with patch.dict(sys.modules):
        for name in 'tf2_msgs', 'tf2_msgs.msg', 'tf2_msgs.srv':
            sys.modules.pop(name, None)
        found = imported_anew('puretf._ros.messages')
    assert found.TFMessage.__doc__ == 'Stands for the real one.'
    assert found.FrameGraph == 42
