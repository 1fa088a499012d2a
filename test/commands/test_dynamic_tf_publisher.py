"""The command `dynamic_tf_publisher`."""

from math import cos, pi, sin

from cli_runner import call
import numpy as np
import pytest
from rclpy.parameter import Parameter
from ros_node import command_node

from dummy_arm.dynamic_tf_publisher import DynamicTfPublisher, main
from puretf import TFMessage


@pytest.mark.parametrize(('argument', 'message'), [
    ('rotation:=x', "rotation must be one of identity, quaternion, euler, got 'x'"),
    ('rotation:=1', 'rotation must be one of identity, quaternion, euler, got 1'),
    ('roll:=.nan', 'roll must be a finite number (rad), got nan'),
    ('yaw:=left', "yaw must be a finite number (rad), got 'left'"),
    ('yaw:=true', 'yaw must be a finite number (rad), got True'),
])
def test_a_bad_start_is_one_line_and_exit_code_2(domain_id, argument, message):
    """The line names the parameter and the values that are allowed."""
    assert call(main, '--ros-args', '-p', argument, domain=domain_id) == (
        2, '', f'dynamic_tf_publisher: {message}\n')


def test_it_says_what_it_publishes_until_a_signal(domain_id):
    """An integer is accepted as an angle."""
    code, output, error = call(
        main, '--ros-args', '-p', 'rotation:=euler', '-p', 'roll:=1', domain=domain_id,
        until=lambda text: 'publishing map -> moving_frame at 10 Hz, rotation: euler\n' in text)
    assert (code, output, error.splitlines()[1:]) == (0, '', [])


@pytest.mark.parametrize(('rotation', 'angles', 'expected'), [
    ('identity', {}, lambda half: [0.0, 0.0, 0.0, 1.0]),
    ('quaternion', {}, lambda half: [0.0, 0.0, sin(half), cos(half)]),
    ('euler', {'yaw': 0.5}, lambda half: [0.0, 0.0, sin(half + 0.25), cos(half + 0.25)]),
    ('euler', {'roll': pi / 2}, lambda half: np.sqrt(0.5) * np.array(
        [cos(half), sin(half), sin(half), cos(half)]))])
def test_a_frame_moves_on_a_circle(domain_id, rotation, angles, expected):
    """It is 0.1 rad further in each message; its rotation can be set while the node runs."""
    with command_node(DynamicTfPublisher, domain_id) as (node, ros):
        node.set_parameters([Parameter(name, value=value) for name, value in {
            'rotation': rotation, **angles}.items()])
        messages: list[TFMessage] = []
        ros.node.create_subscription(TFMessage, '/tf', messages.append, 100)
        ros.until(lambda: len(messages) > 4)
    places = []
    for message in messages:
        (moved,) = message.transforms
        assert (moved.header.frame_id, moved.child_frame_id) == ('map', 'moving_frame')
        at, turn = moved.transform.translation, moved.transform.rotation
        places.append(np.arctan2(at.y, at.x))
        assert (np.hypot(at.x, at.y), at.z) == (pytest.approx(1.0), 0.0)
        assert abs(np.dot([turn.x, turn.y, turn.z, turn.w], expected(places[-1] / 2))
                   ) == pytest.approx(1.0)
    np.testing.assert_allclose(np.diff(np.unwrap(places)), 0.1, atol=1e-9)
