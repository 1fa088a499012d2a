"""
Every part that uses tf2_msgs, as on a Jazzy desktop and in a process of its own.

In a new process nothing has used TFMessage yet, and its type support is not loaded. The tests use
the real tf2_msgs where it is installed, else a stand-in (`support/desktop`), with which
the CI runs other tests, too.
"""

from endings import without_library_lines
from environment import DESKTOP
from processes import TIMEOUT
import pytest
from rclpy.duration import Duration
from rclpy.time import Time
from ros_node import stamped

from puretf import StaticTransformBroadcaster

BEGIN = f"""
import rclpy
from rclpy.duration import Duration
from rclpy.time import Time
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage
WAIT = Duration(seconds={TIMEOUT})

def stamped(parent, child, x=0.0):
    made = TransformStamped(child_frame_id=child)
    made.header.frame_id = parent
    made.transform.translation.x = x
    return made

assert TFMessage.__class__._TYPE_SUPPORT is None
rclpy.init()
node = rclpy.create_node('desktop')
"""


@pytest.fixture
def runs(start):
    """A function that runs code in a process and asserts that it succeeds."""
    def run(code):
        process = start('-c', f'{BEGIN}{code}\nrclpy.shutdown()\nprint("good")',
                        environment=DESKTOP)
        assert process.exit_code() == 0, process.output
        assert without_library_lines(process.output) == 'good\n'

    return run


def test_messages_of_lookups_have_floats(runs):
    """Compiled code does not check numbers, so the results must have none but floats."""
    runs("""
from rclpy.serialization import deserialize_message, serialize_message
from puretf import Buffer, Transform

def sent(*messages):
    data = serialize_message(TFMessage(transforms=messages))
    return deserialize_message(data, TFMessage).transforms

wrong = stamped('map', 'wrong')
wrong.transform.translation._x, wrong.transform.rotation._w = 3, 2
assert sent(wrong)[0].transform.translation.x != 3.0
assert TFMessage.__class__._TYPE_SUPPORT is not None

buffer = Buffer()
buffer.set_transform_static(wrong, 'test')
found = buffer.lookup_transform('map', 'wrong', Time())
made = Transform(0, 'map', 'wrong', (3, 0, 0), (0, 0, 0, 1)).to_message()
assert sent(found, made) == [found, made]
assert (found.transform.translation.x, found.transform.rotation.w) == (3.0, 1.0)
""")


def test_a_listener_is_the_first_to_use_the_message(ros, runs):
    """It receives transforms; one with its own callback receives messages of tf2_msgs."""
    broadcaster = StaticTransformBroadcaster(ros.node)
    broadcaster.sendTransform(stamped('map', 'tool', x=2.0))
    runs("""
import threading
from puretf import Buffer, TransformListener
buffer = Buffer(node=node)
listener = TransformListener(buffer, node)
assert buffer.lookup_transform('map', 'tool', Time(), WAIT).transform.translation.x == 2.0

received, has_received = [], threading.Event()
class Own(TransformListener):
    def static_callback(self, data):
        received.append(data)
        has_received.set()
own = Own(Buffer(node=node), node, spin_thread=True)
assert has_received.wait(WAIT.nanoseconds / 1e9)
assert type(received[0]) is TFMessage
assert received[0].transforms[0] == stamped('map', 'tool', x=2.0)
""")


def test_broadcasters_are_the_first_to_use_the_message(listening, start):
    """Dynamic, static and prepared transforms arrive, also with numbers that are no floats."""
    process = start('-c', BEGIN + """
import numpy as np
from puretf import StaticTransformBroadcaster, TransformBroadcaster
broadcaster = TransformBroadcaster(node)
static = StaticTransformBroadcaster(node)
prepared = broadcaster.prepare([('map', 'prepared')])
whole = stamped('map', 'static')
whole.transform.translation._x = 3
static.sendTransform(whole)
def send():
    broadcaster.sendTransform([stamped('map', 'moving', x=2.0)])
    prepared.send(node.get_clock().now(), np.array([[4, 0, 0, 0, 0, 0, 1]]))
node.create_timer(0.05, send)
rclpy.spin(node)
""", environment=DESKTOP)
    for child, x in ('static', 3.0), ('moving', 2.0), ('prepared', 4.0):
        found = listening.lookup_transform('map', child, Time(), Duration(seconds=TIMEOUT))
        assert found.transform.translation.x == x
    assert not process.has_ended()


def test_the_buffer_serves_its_frames(runs):
    """The service is that of tf2_ros, which view_frames of tf2_tools calls."""
    runs("""
from puretf import Buffer
from tf2_msgs.srv import FrameGraph
buffer = Buffer(node=node)
buffer.set_transform_static(stamped('map', 'tool'), 'test')
client = node.create_client(FrameGraph, 'tf2_frames')
assert client.wait_for_service(WAIT.nanoseconds / 1e9)
future = client.call_async(FrameGraph.Request())
rclpy.spin_until_future_complete(node, future)
response = future.result()
text = getattr(response, 'frame_yaml', '') or response.message
assert text.startswith("tool: \\n  parent: 'map'\\n  broadcaster: 'test'\\n"), text
""")
