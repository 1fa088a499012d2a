"""Tests of TFMessage: the class of tf2_msgs, or the one that is created at run time."""

import copy
import os
import pickle
import subprocess
import sys

from conftest import golden_fields, made_at_run_time
from geometry_msgs.msg import Transform, TransformStamped
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header
from type_description_interfaces.srv import GetTypeDescription

from dummy_arm.tf import TFMessage
from dummy_arm.tf._ros.transform_stamped import message_of_fields, row_of
from dummy_arm.tf._wire import cdr

HASH = 'RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087'


def message(case):
    """Return the message of a golden case."""
    return TFMessage(transforms=[*map(message_of_fields, golden_fields(case))])


def without_padding(data, case):
    """Return the bytes with zeros as alignment padding, which is arbitrary in real messages."""
    return cdr.pack_fields(cdr.fields(data)) if case['transforms'] else data[:8]


def test_serializes_as_tf2_msgs_does(golden_messages):
    """The bytes equal the golden ones, apart from the alignment padding."""
    for case in golden_messages:
        data = serialize_message(message(case))
        assert len(data) == len(case['cdr_hex']) // 2
        assert without_padding(data, case).hex() == case['cdr_hex']


def test_deserializes_as_tf2_msgs_does(golden_messages):
    """The golden bytes give the golden transforms."""
    for case in golden_messages:
        assert deserialize_message(bytes.fromhex(case['cdr_hex']), TFMessage) == message(case)


@made_at_run_time
def test_every_prefix_ends_in_an_exception(golden_messages):
    """A truncated message cannot crash the process; see also test_faults.py."""
    for case in golden_messages:
        data = bytes.fromhex(case['cdr_hex'])
        for end in range(len(data)):
            with pytest.raises((ValueError, RuntimeError)):
                deserialize_message(data[:end], TFMessage)


def test_other_types_are_serialized_as_ever():
    """The support that is added to rclpy affects TFMessage only."""
    transform = TransformStamped(child_frame_id='a')
    assert deserialize_message(serialize_message(transform), TransformStamped) == transform


@pytest.mark.parametrize('element', [
    42, None, 'map', Transform(), TransformStamped(header=None), TransformStamped(transform=None),
    TransformStamped(header=Header(stamp=None)), TransformStamped(child_frame_id=b'a'),
    TransformStamped(child_frame_id='\ud800'), TransformStamped(transform=Transform(rotation=0))])
@made_at_run_time
def test_a_wrong_element_is_not_serialized(element):
    """An exception is raised, wherever in the list the element is."""
    for elements in ([element], [TransformStamped(), element]):
        with pytest.raises((TypeError, ValueError)):
            serialize_message(TFMessage(transforms=elements))


@made_at_run_time
def test_the_error_names_the_field():
    """The error also names the expected type and the value."""
    transform = TransformStamped(child_frame_id='a')
    transform.header.stamp.nanosec = -1
    error = r"1 of 1, to child 'a': header\.stamp\.nanosec must be a uint32, got -1"
    with pytest.raises(ValueError, match=error):
        serialize_message(TFMessage(transforms=[transform]))
    with pytest.raises(TypeError, match='expected a TransformStamped, got 42 of type int'):
        serialize_message(TFMessage(transforms=[42]))


@pytest.mark.parametrize('data', ['text', bytearray(8), None, 7])
@made_at_run_time
def test_only_bytes_are_deserialized(data):
    """Any other type raises TypeError, which names the expected type."""
    with pytest.raises(TypeError, match='expected bytes, got'):
        deserialize_message(data, TFMessage)


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
    assert row_of(checked.transforms[0])[1:3] == ('', '')


def test_its_name_and_hash_are_those_of_tf2_msgs(ros):
    """Other nodes see the type of tf2_msgs on a topic."""
    ros.node.create_publisher(TFMessage, '/tf', 10)
    (info,) = ros.node.get_publishers_info_by_topic('/tf')
    assert info.topic_type == 'tf2_msgs/msg/TFMessage'
    assert str(info.topic_type_hash) == HASH


def test_its_type_description_is_served(ros):
    """The type description service of the node answers a request with the name and hash."""
    ros.node.create_publisher(TFMessage, '/tf', 10)
    client = ros.node.create_client(GetTypeDescription, '/test/get_type_description')
    ros.until(client.service_is_ready)
    future = client.call_async(GetTypeDescription.Request(
        type_name='tf2_msgs/msg/TFMessage', type_hash=HASH, include_type_sources=True))
    ros.until(future.done)
    answer = future.result()
    assert answer.successful, answer.failure_reason
    assert answer.type_description.type_description.type_name == 'tf2_msgs/msg/TFMessage'
    assert sorted(t.type_name for t in answer.type_description.referenced_type_descriptions) == [
        'builtin_interfaces/msg/Time', 'geometry_msgs/msg/Quaternion',
        'geometry_msgs/msg/Transform', 'geometry_msgs/msg/TransformStamped',
        'geometry_msgs/msg/Vector3', 'std_msgs/msg/Header']
    assert 'TransformStamped[] transforms' in answer.type_sources[0].raw_file_contents


def run(code):
    """Run code in another process, and return its output."""
    done = subprocess.run([sys.executable, '-c', code], text=True, capture_output=True,
                          env=os.environ, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(('change', 'error'), [
    ('msg.Polygon = msg.Point32', "found (b'geometry_msgs::msg', b'Point32')"),
    ('msg.Polygon = msg.PolygonInstance', "found (b'geometry_msgs::msg', b'PolygonInstance')"),
    ('msg.TransformStamped.__class__._TYPE_SUPPORT = None; '
     'msg.TransformStamped.__class__.__import_type_support__(); '
     'import json; json.dumps = lambda value: ""', 'the hash of geometry_msgs/msg/TransformSt')])
@made_at_run_time
def test_a_mismatch_is_an_import_error(change, error):
    """If geometry_msgs is not that of Jazzy, the error says what was expected and found."""
    printed = run(
        f'from geometry_msgs import msg\n{change}\n'
        'try:\n    import dummy_arm.tf._tf2_msgs.tf_message\n'
        'except ImportError as error:\n    print(error)')
    assert error in printed
    assert 'expected' in printed


def test_the_real_one_is_used_where_it_is(tmp_path):
    """If tf2_msgs can be imported, dummy_arm.tf exports its class."""
    package = tmp_path / 'tf2_msgs'
    package.mkdir()
    for name in '__init__.py', 'srv.py', 'tf2_msgs_s__rosidl_typesupport_c.so':
        (package / name).touch()
    (package / 'msg.py').write_text('class TFMessage:\n    """Stands for the real one."""\n')
    (package / 'srv.py').write_text('FrameGraph = None\n')
    assert run(f'import sys; sys.path.insert(0, {str(tmp_path)!r})\n'
               'from dummy_arm.tf import TFMessage; print(TFMessage.__module__)'
               ) == 'tf2_msgs.msg\n'
