"""Tests of the examples in docs/examples."""

from pathlib import Path
import re
import signal

from conftest import ARM
import pytest

from dummy_arm.tf import TFMessage
from dummy_arm.tf._ros.transform_stamped import row_of
from dummy_arm.tf._wire.cdr import unpack

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize('signal_number', [signal.SIGINT, signal.SIGTERM])
def test_listen_receives_the_arm(start, signal_number):
    """The example prints the transforms of the arm, as `make listen` beside `make demo`."""
    start(*ARM).line_with('t = 0')
    listener = start(str(ROOT / 'docs' / 'examples' / 'listen.py'))
    listener.line_with('map -> base_link')
    listener.line_with('joint_3 -> end_effector xyz  0.200  0.000  0.000')
    listener.end(signal_number)
    assert listener.exit_code() == 0
    assert 'Traceback' not in listener.output


#: The example, with a line of output when the bag has 50 messages, since discovery takes time.
RECORDER = f"""
import threading, time
names = {{}}
def tell():
    while 'bag' not in names or sum(list(names['bag'].counts.values())) < 50:
        time.sleep(0.01)
    print('has recorded', flush=True)
threading.Thread(target=tell, daemon=True).start()
path = {str(ROOT / 'docs' / 'examples' / 'record.py')!r}
exec(compile(open(path).read(), path, 'exec'), names)
"""


def stamp_of(message):
    """Return the first stamp of a message (ns)."""
    return row_of(message.transforms[0]).stamp_ns


def test_record_reports_dropped_messages(start, tmp_path):
    """Messages are dropped if more arrive between two calls of `received` than are kept."""
    pytest.importorskip('rosbags.rosbag2')
    recorder = start('-c', 'from dummy_arm.tf import publisher_listener\n'
                     'publisher_listener._MOST_MESSAGES = 2\n'
                     + RECORDER, str(tmp_path / 'bag'))
    recorder.line_with('recording')
    start(*ARM)
    assert re.search(r'\[ERROR\].* [1-9]\d* messages arrived too fast and are not in the bag\n',
                     recorder.line_with('messages arrived too fast'))
    recorder.end(signal.SIGINT)
    assert recorder.exit_code() == 0
    assert 'Traceback' not in recorder.output


@pytest.mark.parametrize('signal_number', [
    signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.soak)])
def test_record_writes_a_bag_of_the_arm(start, ros, tmp_path, signal_number):
    """The bag has all messages with the times of their arrival, and the QoS of both topics."""
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    from rosbags.interfaces import QosDurability

    from dummy_arm.tf.bag import read

    received: list[TFMessage] = []
    ros.node.create_subscription(TFMessage, '/tf', received.append, 100)
    recorder = start('-c', RECORDER, str(tmp_path / 'bag'))
    ros.until(lambda: ros.node.count_subscribers('/tf') == 2)
    start(*ARM)
    ros.until(lambda: len(received) > 50 and 'has recorded' in recorder.output)
    recorder.end(signal_number)
    assert recorder.exit_code() == 0
    assert 'Traceback' not in recorder.output
    assert recorder.output.endswith(' messages\n')
    joint_1 = {frame.name: frame for frame in read(tmp_path / 'bag').frames()}['joint_1']
    with rosbag2.Reader(tmp_path / 'bag') as bag:
        assert {connection.topic: connection.ext.offered_qos_profiles[0].durability
                for connection in bag.connections} == {
            '/tf': QosDurability.VOLATILE, '/tf_static': QosDurability.TRANSIENT_LOCAL}
        found = [(connection.topic, time, unpack(data)[0])
                 for connection, time, data in bag.messages()]
    assert {(topic, row.child_frame_id) for topic, _, row in found} == {
        ('/tf', 'joint_1'), ('/tf_static', 'base_link')}
    # The first messages may have waited for the discovery.
    assert all(0 <= time - row.stamp_ns < 10 * 10**9
               for topic, time, row in found if topic == '/tf')
    recorded = [row.stamp_ns for topic, _, row in found if topic == '/tf']
    both = [stamp for message in received
            if recorded[0] <= (stamp := stamp_of(message)) <= recorded[-1]]
    assert len(both) > 20
    assert [stamp for stamp in recorded if both[0] <= stamp <= both[-1]] == both
    assert joint_1.length == len(recorded)
