"""Tests of messages and threads that must neither crash nor stop a process, over DDS."""

from conftest import made_at_run_time
from geometry_msgs.msg import TransformStamped
import pytest

from dummy_arm.tf import TFMessage
from dummy_arm.tf._core.pose import Row
from dummy_arm.tf._ros.transform_stamped import message_of

S = 10**9
SUBSCRIBER = """
import rclpy
from dummy_arm.tf import TFMessage
rclpy.init()
node = rclpy.create_node('subscriber')
node.create_subscription(
    TFMessage, '/tf', lambda m: print([t.child_frame_id for t in m.transforms]), 1000)
print('ready')
rclpy.spin(node)
"""


def start_subscriber(ros, start, depth=10, code=SUBSCRIBER):
    """Start a subscriber, and create a publisher that is connected to it."""
    process = start('-c', code)
    process.line_with('ready')
    publisher = ros.node.create_publisher(TFMessage, '/tf', depth)
    ros.until(lambda: publisher.get_subscription_count() == 1)
    return process, publisher


@made_at_run_time
def test_malformed_messages_are_dropped(ros, start, golden_messages):
    """A subscriber drops each prefix of a golden message, and takes the next valid message."""
    process, publisher = start_subscriber(ros, start, depth=1000)
    good = TFMessage(transforms=[TransformStamped(child_frame_id='good')])
    longest = max(golden_messages, key=lambda case: len(case['cdr_hex']))
    data = bytes.fromhex(longest['cdr_hex'])
    billion = data[:4] + (10**9).to_bytes(4, 'little') + data[8:]
    for bad in (*(data[:end] for end in range(4, len(data))), billion):
        publisher.publish(bad)
        if len(bad) % 100 == 0:
            publisher.publish(good)
            process.line_with("['good']")
    publisher.publish(good)
    process.line_with("['good']")
    assert process.output.count('dropped a message on /tf') == 1
    assert 'Traceback' not in process.output


@pytest.mark.parametrize('wrong', [42, None, TransformStamped(header=None)])
@made_at_run_time
def test_a_wrong_element_sends_nothing(ros, start, wrong):
    """`publish` raises an exception, and the next message is the first that arrives."""
    process, publisher = start_subscriber(ros, start)
    with pytest.raises((TypeError, ValueError)):
        publisher.publish(TFMessage(transforms=[TransformStamped(child_frame_id='a'), wrong]))
    publisher.publish(TFMessage(transforms=[TransformStamped(child_frame_id='b')]))
    assert process.line() == "['b']\n"


def test_a_wrong_message_is_a_type_error(ros):
    """`publish` checks the type of the message, as for other message types."""
    publisher = ros.node.create_publisher(TFMessage, '/tf', 10)
    with pytest.raises(TypeError):
        publisher.publish(TransformStamped())


def test_objects_and_bytes_both_ways(ros):
    """A message is published as an object or as bytes, and received as either."""
    objects: list[TFMessage] = []
    raw: list[bytes] = []
    with_info = []
    ros.node.create_subscription(TFMessage, '/tf', objects.append, 10)
    ros.node.create_subscription(TFMessage, '/tf', raw.append, 10, raw=True)
    ros.node.create_subscription(
        TFMessage, '/tf', lambda message, info: with_info.append((message, info)), 10)
    publisher = ros.node.create_publisher(TFMessage, '/tf', 10)
    message = TFMessage(transforms=[
        message_of(Row(S + 2, 'a', 'b', (1.5, 0, 0, 0.0, 0.0, 0.0, 1.0)))])
    publisher.publish(message)
    ros.until(lambda: objects and raw and with_info)
    assert objects[0] == message
    assert with_info[0][0] == message
    assert with_info[0][1]['source_timestamp'] > 0
    publisher.publish(raw[0])
    ros.until(lambda: len(objects) == 2)
    assert objects[1] == message


def test_a_large_message_arrives(ros, start):
    """Another process receives half a megabyte as an object, as which it was published."""
    process, publisher = start_subscriber(ros, start, code=SUBSCRIBER.replace(
        '[t.child_frame_id for t in m.transforms]',
        'len(m.transforms), m.transforms[-1].transform'))
    rows = [Row(S + 2, f'frame_{i}', f'frame_{i + 1}', (i, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
            for i in range(5000)]
    publisher.publish(TFMessage(transforms=[message_of(row) for row in rows]))
    line = process.line()
    assert line.startswith('5000 ')
    assert 'x=4999.0' in line


THREADS = """
import sys, threading, time
import rclpy
from dummy_arm.tf import TFMessage, TransformBroadcaster
from geometry_msgs.msg import TransformStamped
from rclpy.executors import MultiThreadedExecutor
rclpy.init()
node = rclpy.create_node('threads')
transform = TransformStamped(child_frame_id='b')
transform.header.frame_id = 'a'
message = TFMessage(transforms=[transform] * 20)
publisher = node.create_publisher(TFMessage, '/tf', 10)
broadcaster = TransformBroadcaster(node)
taken = 0
def take(message):
    global taken
    taken += 1
node.create_subscription(TFMessage, '/tf', take, 10)
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
while not taken:
    time.sleep(0.01)
rclpy.shutdown()
spinner.join()
print('done')
"""


def test_threads_do_not_block_each_other(start):
    """Three threads publish while others take messages and create publishers: no deadlock."""
    process = start('-X', 'faulthandler', '-c', THREADS)
    assert process.line_with('done')
    assert process.exit_code() == 0
