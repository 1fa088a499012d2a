"""The lab of the course, step by step, with its own commands over DDS."""

from itertools import pairwise
from math import cos, pi, sin
import signal

from conftest import ARM, tool
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy

from dummy_arm.arm import Arm
from dummy_arm.tf import TFMessage
from dummy_arm.tf._ros.qos import profile

LATCHED = profile(None, 10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def receive(ros, number):
    """
    Receive messages of /tf that have one transform each.

    :returns: the stamps (s), the translations (m), and the rotations (quaternions x, y, z, w).
    """
    messages: list[TFMessage] = []
    subscription = ros.node.create_subscription(TFMessage, '/tf', messages.append, 100)
    ros.until(lambda: len(messages) >= number)
    ros.node.destroy_subscription(subscription)
    transforms = [message.transforms[0] for message in messages]
    assert {(t.header.frame_id, t.child_frame_id) for t in transforms} == {('map', 'moving_frame')}
    return (np.array([t.header.stamp.sec + t.header.stamp.nanosec / 1e9 for t in transforms]),
            np.array([[t.transform.translation.x, t.transform.translation.y,
                       t.transform.translation.z] for t in transforms]),
            np.array([[t.transform.rotation.x, t.transform.rotation.y, t.transform.rotation.z,
                       t.transform.rotation.w] for t in transforms]))


def test_step_1_static_transform(ros, start):
    """Frames with slashes and the old style work; a later subscriber gets the transform, too."""
    process = start(*tool(
        'static_transform_publisher', '1', '0', '0', '0', '0', '0', '/map', '/base_link'))
    process.line_with("from '/map' to '/base_link'")
    messages: list[TFMessage] = []
    ros.node.create_subscription(TFMessage, '/tf_static', messages.append, LATCHED)
    ros.until(lambda: messages)
    (transform,) = messages[0].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ('/map', '/base_link')
    assert transform.transform.translation.x == 1.0
    assert transform.transform.rotation.w == 1.0
    echo = start(*tool('tf2_echo', 'map', 'base_link', '--once'))
    assert echo.exit_code() == 0
    assert '- Translation: [1.000, 0.000, 0.000]\n' in echo.output
    process.end(signal.SIGINT)
    assert process.exit_code() == 0
    assert 'Traceback' not in process.output


def test_steps_2_to_4_dynamic_transform(ros, start):
    """The frame moves on a circle; each kind of rotation can be set while it runs."""
    process = start(*tool('dynamic_tf_publisher'))
    stamps, points, rotations = receive(ros, 15)
    assert np.median(np.diff(stamps)) == pytest.approx(0.1, rel=0.1)
    angles = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
    np.testing.assert_allclose(np.diff(angles), 0.1, atol=1e-9)
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 1.0, atol=1e-9)
    assert (points[:, 2] == 0.0).all()
    assert (rotations == [0.0, 0.0, 0.0, 1.0]).all()

    def set_to(name, value):
        setting = start(*tool('param', 'dynamic_tf_publisher', name, value))
        assert setting.exit_code() == 0, setting.output

    set_to('rotation', 'quaternion')
    _, points, by_hand = receive(ros, 5)
    for (x, y, _), (*axis, w) in zip(points, by_hand):
        assert axis[:2] == [0.0, 0.0]
        assert (1 - 2 * axis[2] ** 2, 2 * axis[2] * w) == pytest.approx((x, y), abs=1e-9)

    set_to('rotation', 'euler')
    _, points, by_euler = receive(ros, 5)
    for (x, y, _), (*axis, w) in zip(points, by_euler):
        assert (1 - 2 * axis[2] ** 2, 2 * axis[2] * w) == pytest.approx((x, y), abs=1e-9)
    set_to('roll', str(pi / 2))
    _, points, by_euler = receive(ros, 5)
    for (x, y, _), quaternion in zip(points, by_euler):
        half = np.arctan2(y, x) / 2
        expected = np.array([cos(half), sin(half), sin(half), cos(half)]) * np.sqrt(0.5)
        np.testing.assert_allclose(
            quaternion * np.sign(quaternion @ expected), expected, atol=1e-9)
    process.end(signal.SIGTERM)
    assert process.exit_code() == 0


def test_steps_5_and_6_the_frames_of_the_arm(start, tmp_path):
    """view_frames draws the running arm to frames.pdf in the current directory."""
    start(*ARM).line_with('t = 0')
    process = start(*tool('view_frames'), cwd=tmp_path)
    assert process.exit_code() == 0, process.output
    assert process.output == (
        'wrote frames.pdf and frames.gv: frames: 6, transforms: 5, root: map\n')
    assert {path.name for path in tmp_path.iterdir()} == {'frames.pdf', 'frames.gv'}
    pypdf = pytest.importorskip('pypdf')
    (page,) = pypdf.PdfReader(tmp_path / 'frames.pdf').pages
    heights: dict[str, float] = {}
    text = page.extract_text(visitor_text=lambda text, _, matrix, *rest: heights.setdefault(
        text.strip(), matrix[5]))
    lines = [line.strip() for line in text.splitlines()]
    frames = ['map', *Arm().frames]
    assert sorted(line for line in lines if line in frames) == sorted(frames)
    down = [heights[frame] for frame in frames]  # the root is at the top of the page
    assert down == sorted(set(down))
    assert lines.count('Broadcaster: /dummy_arm') == 5
    assert lines.count('static') == 1
    rates = [float(line.split()[2]) for line in lines if line.startswith('Average rate: ')]
    assert len(rates) == 4
    assert 25.0 < min(rates) <= max(rates) < 55.0  # the rate is 50 Hz, less on a busy machine
    lengths = [float(line.split()[2]) for line in lines if line.startswith('Buffer length: ')]
    assert len(lengths) == 4
    assert 0.5 < min(lengths) <= max(lengths) < 5.5  # the discovery of the arm may take seconds
    dot = (tmp_path / 'frames.gv').read_text()
    for parent, child in pairwise(frames):
        assert f'"{parent}" -> "{child}" [' in dot
    assert dot.count('->') == 5
