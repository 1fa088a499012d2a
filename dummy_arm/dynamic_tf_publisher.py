"""
The command `dynamic_tf_publisher`: publish a frame that moves on a circle around map.

Ten times a second, the node publishes on /tf the pose of the frame moving_frame in the frame map.
From one message to the next, the angle of moving_frame on the circle grows by 0.1 rad. The
parameter `rotation` selects the orientation of moving_frame:

- identity: the axes of moving_frame are parallel to those of map.
- quaternion: moving_frame is rotated about the z axis, by the angle on the circle.
- euler: the rotation is computed from three Euler angles. The roll angle is the parameter `roll`,
  the pitch angle is the parameter `pitch`, and the yaw angle is the angle on the circle plus the
  parameter `yaw`. If all three parameters are 0 (the default), the rotation is the same as for
  quaternion.
"""

from collections.abc import Sequence
from functools import partial
from math import cos, isfinite, sin
from typing import Optional

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from puretf import Transform, TransformBroadcaster
from puretf.rotations import quaternion_from_euler
from puretf_tools.cli.node import run_node
from puretf_tools.cli.parser import add_namespace_option, Parser, run

#: The values of the parameter `rotation`.
ROTATIONS = ('identity', 'quaternion', 'euler')
#: The parameters for the Euler angles (rad).
OFFSETS = ('roll', 'pitch', 'yaw')
#: Time between two messages (s).
PERIOD = 0.1
#: Change of the angle on the circle from one message to the next (rad).
STEP = 0.1


class DynamicTfPublisher(Node):
    """A node that publishes map -> moving_frame ten times a second."""

    def __init__(self) -> None:
        super().__init__('dynamic_tf_publisher')
        # Without dynamic typing, ROS would reject roll:=1, because 1 is an integer.
        any_type = ParameterDescriptor(dynamic_typing=True)
        self.add_on_set_parameters_callback(self.check)
        self.declare_parameter('rotation', 'identity', any_type)
        for name in OFFSETS:
            self.declare_parameter(name, 0.0, any_type)
        self.angle = 0.0  # angle of moving_frame on the circle (rad)
        self.broadcaster = TransformBroadcaster(self)
        self.timer = self.create_timer(PERIOD, self.publish)
        self.get_logger().info(f'publishing map -> moving_frame at {1 / PERIOD:g} Hz, rotation: '
                               f'{self.get_parameter("rotation").value}')

    def check(self, parameters: list[Parameter]) -> SetParametersResult:
        """Accept or reject new values of parameters, before they are set."""
        for parameter in parameters:
            name, value, expected = parameter.name, parameter.value, ''
            if name == 'rotation' and value not in ROTATIONS:
                expected = f'one of {", ".join(ROTATIONS)}'
            if name in OFFSETS and not (type(value) in (int, float) and isfinite(value)):
                expected = 'a finite number (rad)'
            if expected:
                return SetParametersResult(
                    successful=False, reason=f'{name} must be {expected}, got {value!r}')
        return SetParametersResult(successful=True)

    def publish(self) -> None:
        self.broadcaster.sendTransform(Transform(
            self.get_clock().now().nanoseconds, 'map', 'moving_frame',
            (cos(self.angle), sin(self.angle), 0.0), self.rotation()).to_message())
        self.angle += STEP

    def rotation(self) -> tuple[float, float, float, float]:
        """Return the current rotation of moving_frame as a quaternion x, y, z, w."""
        kind = self.get_parameter('rotation').value
        if kind == 'quaternion':
            # x, y, z, w of a rotation about the z axis are 0, 0, sin(angle / 2), cos(angle / 2).
            return 0.0, 0.0, sin(self.angle / 2), cos(self.angle / 2)
        if kind == 'euler':
            # Roll, pitch and yaw are rotations about the fixed axes x, y and z, in this order.
            roll, pitch, yaw = (float(self.get_parameter(name).value) for name in OFFSETS)
            return quaternion_from_euler(roll, pitch, self.angle + yaw)
        return 0.0, 0.0, 0.0, 1.0


def main(args: Optional[Sequence[str]] = None) -> int:
    parser = Parser(
        'dynamic_tf_publisher', 'Publish map -> moving_frame on /tf, ten times a second, until '
        'Ctrl-C.\nThe frame moves around map on a circle of radius 1 m.',
        'parameters, which can also be set while the node runs:\n'
        '  rotation          identity (default), quaternion (about z, by the angle on the\n'
        '                    circle) or euler (roll, pitch, and yaw plus the angle on the\n'
        '                    circle)\n'
        '  roll, pitch, yaw  Euler angles for rotation:=euler (rad; default 0)\n\n'
        'example: dynamic_tf_publisher --ros-args -p rotation:=euler -p roll:=0.5')
    add_namespace_option(parser, 'publish on', 'tf')
    return run(parser, partial(run_node, DynamicTfPublisher), args)
