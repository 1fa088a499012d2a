"""JointState messages that are read from bytes, in every node that subscribes to them."""

from array import array
from contextlib import suppress
import struct

from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from puretf import TFMessage
from puretf_tools.inspection.joint_states import deserialize
from puretf_tools.robot.description import parse
from puretf_tools.robot.description_listener import RobotListener
from puretf_tools.robot.joint_senders import JointCommander
from puretf_tools.robot.state_publisher import RobotStatePublisher

NUMBERS = st.lists(st.floats(allow_nan=False), max_size=3).map(lambda each: array('d', each))
NAMES = st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=9)
URDF = ('<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
        '<parent link="a"/><child link="b"/></joint></robot>')
GOOD = bytes(serialize_message(JointState(
    header=Header(stamp=Time(sec=1)), name=['j'], position=[1.0])))
#: A number of names that does not fit.
BAD = GOOD[:20] + struct.pack('<I', 2**31 - 1) + GOOD[24:]


@given(st.builds(JointState, name=st.lists(NAMES, max_size=3), position=NUMBERS, velocity=NUMBERS,
                 effort=NUMBERS), NAMES, st.integers(-2**31, 2**31 - 1), st.integers(0, 2**32 - 1))
def test_messages_are_those_of_the_middleware(message, frame_id, sec, nanosec):
    """All fields are equal, and those of each beginning of a message that is not refused."""
    message.header.frame_id = frame_id
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    data = bytes(serialize_message(message))
    assert deserialize(data) == message
    for end in range(len(data)):
        with suppress(ValueError):
            assert deserialize(data[:end]) == deserialize_message(data[:end], JointState)


@pytest.mark.parametrize('data', [
    b'', b'\0', b'\7\7\0\0' + GOOD[4:], BAD, GOOD[:12] + b'\xff' * 4 + GOOD[16:],
    GOOD[:24] + b'\xff' * 4 + GOOD[28:], GOOD[:32] + b'\xff' * 4 + GOOD[36:]], ids=range(7))
def test_malformed_messages(data):
    """A length or a number that is too large is an error, and takes no memory."""
    with pytest.raises(ValueError, match='a JointState '):
        deserialize(data)


def robot_state_publisher(ros, make_node):
    """Return what takes messages, and what returns true once it has taken a good one."""
    make_node(URDF, kind=RobotStatePublisher, is_spun=True)
    received: list[TFMessage] = []
    ros.node.create_subscription(TFMessage, '/tf', received.append, 10)
    return lambda: received


def robot_listener(ros, make_node):
    """Return as above, for tf_doctor."""
    listener = RobotListener(ros.node)

    def has_taken():
        listener.poll()
        return listener.senders()['/joint_states'] if listener.senders() else False

    return has_taken


def joint_commander(ros, make_node):
    """Return as above, for the page."""
    commander = JointCommander(ros.node, '/joint_command', '/joint_states', parse(URDF))

    def has_taken():
        commander.take_reported()
        return commander.positions['j'] == 1.0

    return has_taken


@pytest.mark.parametrize('start', [robot_state_publisher, robot_listener, joint_commander])
def test_malformed_messages_are_named_once(ros, make_node, capfd, start):
    """The middleware prints nothing, and the next good message is taken."""
    publisher = make_node('liar').create_publisher(JointState, '/joint_states', 10)
    has_taken = start(ros, make_node)
    malformed = iter([BAD] * 20)

    def is_done():
        publisher.publish(next(malformed, GOOD))
        return has_taken()

    ros.until(lambda: has_taken() or publisher.get_subscription_count())
    ros.until(is_done)
    error = capfd.readouterr().err
    assert 'sequence size' not in error
    assert error.count('joint_states') == 1
    assert ('dropped a message on /joint_states that cannot be decoded: a JointState of '
            f'{len(BAD)} bytes ends in the middle of a field; published by /liar. Fur') in error
