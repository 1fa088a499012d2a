"""
Every part that uses tf2_msgs, as on a Jazzy desktop and in a process of its own.

In a new process nothing has used TFMessage yet, and its type support is not loaded. The tests use
the real tf2_msgs where it is installed, else a stand-in (`desktop/`).
"""

from urllib.request import urlopen

from conftest import ARM, DESKTOP, TIMEOUT, tool
from endings import without_library_lines
import pytest
from rclpy.duration import Duration
from rclpy.time import Time

from dummy_arm.tf import Buffer, TransformListener

pytestmark = pytest.mark.desktop

BEGIN = """
import rclpy
from rclpy.duration import Duration
from rclpy.time import Time
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage
WAIT = Duration(seconds=20)

def made(parent, child, x):
    made = TransformStamped(child_frame_id=child)
    made.header.frame_id = parent
    made.transform.translation.x = x
    return made

assert TFMessage.__class__._TYPE_SUPPORT is None
rclpy.init()
node = rclpy.create_node('desktop')
"""
END = """
rclpy.shutdown()
print('good')
"""


@pytest.fixture
def runs(start):
    """A function that runs code in a process and asserts that it succeeds."""
    def run(code):
        process = start('-c', BEGIN + code + END, environment=DESKTOP)
        assert process.exit_code() == 0, process.output
        assert without_library_lines(process.output) == 'good\n'

    return run


@pytest.fixture
def buffer(ros):
    """A buffer of the test itself, filled by a listener."""
    filled = Buffer(node=ros.node)
    listener = TransformListener(filled, ros.node)
    yield filled
    listener.unregister()


def test_the_message_is_as_generated(runs):
    """Its type support is loaded late, and its numbers are converted without a check."""
    runs("""
from rclpy.serialization import deserialize_message, serialize_message
message = TFMessage(transforms=[made('map', 'a', 2.0), made('map', 'b', 2.0)])
message.transforms[1].transform.translation._x = 2
found = deserialize_message(serialize_message(message), TFMessage)
assert type(found) is TFMessage
assert TFMessage.__class__._TYPE_SUPPORT is not None
a, b = (transform.transform.translation.x for transform in found.transforms)
assert a == 2.0 and b != 2.0
""")


@pytest.mark.parametrize('listener', [
    'dummy_arm.tf TransformListener', 'dummy_arm.tf.publisher_listener PublisherListener'])
def test_a_listener_is_the_first_to_use_the_message(start, runs, listener):
    """The listener receives the transforms of the arm."""
    start(*ARM, environment=DESKTOP)
    module, name = listener.split()
    runs(f"""
from {module} import {name} as Listener
from dummy_arm.tf import Buffer
buffer = Buffer(node=node)
listener = Listener(buffer, node)
assert buffer.lookup_transform('map', 'end_effector', Time(), timeout=WAIT)
""")


def test_a_listener_calls_what_is_overridden(start, runs):
    """The callback receives messages of tf2_msgs, whose numbers are floats."""
    start(*ARM, environment=DESKTOP)
    runs("""
import threading
from dummy_arm.tf import Buffer, TransformListener
heard, has_heard = [], threading.Event()
class Own(TransformListener):
    def callback(self, data):
        heard.append(data)
        has_heard.set()
listener = Own(Buffer(node=node), node)
assert has_heard.wait(20)
assert type(heard[0]) is TFMessage
assert heard[0].transforms[0].child_frame_id == 'joint_1'
""")


def test_broadcasters_are_the_first_to_use_the_message(ros, buffer, start):
    """Dynamic, static and prepared transforms arrive, also with numbers that are no floats."""
    process = start('-c', BEGIN + """
import numpy as np
from dummy_arm.tf import StaticTransformBroadcaster, TransformBroadcaster
broadcaster = TransformBroadcaster(node)
static = StaticTransformBroadcaster(node)
prepared = broadcaster.prepare([('map', 'prepared')])
whole = made('map', 'static', 1.0)
whole.transform.translation._x = 3
static.sendTransform(whole)
def send():
    broadcaster.sendTransform([made('map', 'moving', 2.0)])
    prepared.send(node.get_clock().now(), np.array([[4, 0, 0, 0, 0, 0, 1]]))
node.create_timer(0.05, send)
print('sending')
rclpy.spin(node)
""", environment=DESKTOP)
    process.line_with('sending')
    for child, x in ('static', 3.0), ('moving', 2.0), ('prepared', 4.0):
        found = buffer.lookup_transform('map', child, Time(), timeout=Duration(seconds=TIMEOUT))
        assert found.transform.translation.x == x


def test_what_a_lookup_gives_can_be_published(runs):
    """The numbers of the result are floats, whatever was inserted."""
    runs("""
from rclpy.serialization import deserialize_message, serialize_message
from dummy_arm.tf import Buffer
from dummy_arm.tf._ros.transform_stamped import message_of
buffer = Buffer()
whole = made('map', 'whole', 1.0)
whole.transform.translation._x, whole.transform.rotation._w = 3, 2
buffer.set_transform_static(whole, 'test')
found = buffer.lookup_transform('map', 'whole', Time())
of_row = message_of((1_000_000_002, 'map', 'whole', (3, 0, 0, 0, 0, 0, 1)))
for message in found, of_row:
    (sent,) = deserialize_message(serialize_message(TFMessage(transforms=[message])),
                                  TFMessage).transforms
    assert sent == message
    assert sent.transform.translation.x == 3.0
    assert sent.transform.rotation.w == 1.0
""")


def test_the_buffer_serves_its_frames(ros, start):
    """The service is that of tf2_ros, which view_frames of tf2_tools calls."""
    process = start('-c', BEGIN + """
from dummy_arm.tf import Buffer
buffer = Buffer(node=node)
buffer.set_transform_static(made('map', 'tool', 1.0), 'test')
assert buffer.srv.srv_name == 'tf2_frames'
print('serving')
rclpy.spin(node)
""", environment=DESKTOP)
    process.line_with('serving')
    asking = start('-c', BEGIN + """
from tf2_msgs.srv import FrameGraph
client = node.create_client(FrameGraph, 'tf2_frames')
assert client.wait_for_service(20.0)
future = client.call_async(FrameGraph.Request())
rclpy.spin_until_future_complete(node, future, timeout_sec=20.0)
response = future.result()
print(getattr(response, 'frame_yaml', '') or response.message)
rclpy.shutdown()
""", environment=DESKTOP)
    assert asking.exit_code() == 0
    assert asking.output.startswith("tool: \n  parent: 'map'\n  broadcaster: 'test'\n")


@pytest.mark.parametrize(('command', 'frame'), [
    (('dummy_arm',), 'end_effector'),
    (('dynamic_tf_publisher',), 'moving_frame'),
    (('static_transform_publisher', '--x', '1', '--frame-id', 'map', '--child-frame-id', 'tool'),
     'tool')], ids=lambda value: value[0] if isinstance(value, tuple) else '')
def test_a_command_that_publishes(start, buffer, command, frame):
    """Its transforms arrive, and it prints no error."""
    process = start(*tool(*command), environment=DESKTOP)
    assert buffer.lookup_transform('map', frame, Time(), timeout=Duration(seconds=TIMEOUT))
    process.press_ctrl_c()
    assert process.exit_code() == 0
    assert 'Error' not in process.output


@pytest.mark.parametrize(('command', 'text'), [
    (('param', 'dummy_arm', 'rate'), '50.0'),
    (('tf2_echo', 'map', 'end_effector', '--once'), '- Translation: ['),
    (('tf_doctor', '--time', '1', '--ignore', 'gap', '--ignore', 'late'), 'healthy: '),
    (('tf_trajectory', 'map', 'end_effector', '--time', '1'), 'stamp_ns,'),
    (('view_frames', '--text'), 'end_effector')],
    ids=lambda value: value[0] if isinstance(value, tuple) else '')
def test_a_command_that_listens_and_ends(start, command, text):
    """It prints data of the arm, and no error."""
    start(*ARM, environment=DESKTOP).line_with('publishing map')
    process = start(*tool(*command), environment=DESKTOP)
    assert process.exit_code() == 0
    assert text in process.output
    assert 'Error' not in process.output


def test_tf2_monitor(start):
    """It prints the frames of the arm until Ctrl-C."""
    start(*ARM, environment=DESKTOP).line_with('publishing map')
    process = start(*tool('tf2_monitor'), environment=DESKTOP)
    process.line_with('end_effector')
    process.press_ctrl_c()
    assert process.exit_code() == 0
    assert 'Error' not in process.output


def test_web_view(start):
    """It serves its page until Ctrl-C, and prints no error."""
    pytest.importorskip('viser', reason='viser, which makes the page, is not installed')
    start(*ARM, environment=DESKTOP).line_with('publishing map')
    process = start(*tool('web_view'), environment=DESKTOP)
    url = process.line_with('look at http').split()[-1]
    assert b'<html' in urlopen(url).read()
    process.press_ctrl_c()
    assert process.exit_code() == 0
    assert process.output == f'look at {url}\n'
