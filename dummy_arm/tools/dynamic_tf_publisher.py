"""The command `dynamic_tf_publisher`: a frame that goes round, turned in three ways."""

from collections.abc import Sequence
from math import cos, isfinite, sin
from typing import Optional

from geometry_msgs.msg import TransformStamped
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from dummy_arm.cli.node import run_node
from dummy_arm.cli.parser import Parser, run, UsageError
from dummy_arm.tf import TransformBroadcaster
from dummy_arm.tf.rotations import quaternion_from_euler

ROTATIONS = ('identity', 'quaternion', 'euler')
OFFSETS = ('roll', 'pitch', 'yaw')
PERIOD = 0.1  # s
STEP = 0.1  # rad in each period


class DynamicTfPublisher(Node):
    """Publishes map -> moving_frame, ten times a second."""

    def __init__(self) -> None:
        """
        Create the node and start to publish.

        :raises UsageError: on a parameter that was given a senseless value.
        """
        super().__init__('dynamic_tf_publisher')
        any_type = ParameterDescriptor(dynamic_typing=True)  # an integer is a number, too
        self.declare_parameter('rotation', 'identity', any_type)
        for name in OFFSETS:
            self.declare_parameter(name, 0.0, any_type)
        for name in ('rotation', *OFFSETS):
            if reason := problem(self.get_parameter(name)):
                raise UsageError(reason)
        self.add_on_set_parameters_callback(self.check)
        self.angle = 0.0
        self.broadcaster = TransformBroadcaster(self)
        self.timer = self.create_timer(PERIOD, self.publish)
        self.get_logger().info(f'publishing map -> moving_frame at {1 / PERIOD:g} Hz, rotation: '
                               f'{self.get_parameter("rotation").value}')

    def check(self, parameters: list[Parameter]) -> SetParametersResult:
        """Refuse senseless values, with the reason."""
        reasons = [reason for parameter in parameters if (reason := problem(parameter))]
        return SetParametersResult(successful=not reasons, reason='; '.join(reasons))

    def publish(self) -> None:
        """Publish where the frame is now, and how it is turned."""
        message = TransformStamped(child_frame_id='moving_frame')
        message.header.frame_id = 'map'
        message.header.stamp = self.get_clock().now().to_msg()

        message.transform.translation.x = cos(self.angle)
        message.transform.translation.y = sin(self.angle)
        message.transform.translation.z = 0.0

        x, y, z, w = self.rotation()
        message.transform.rotation.x = x
        message.transform.rotation.y = y
        message.transform.rotation.z = z
        message.transform.rotation.w = w

        self.broadcaster.sendTransform(message)
        self.angle += STEP

    def rotation(self) -> tuple[float, float, float, float]:
        """Give the rotation as a quaternion x, y, z, w."""
        kind = self.get_parameter('rotation').value
        if kind == 'quaternion':  # by the angle, about z
            return 0.0, 0.0, sin(self.angle / 2), cos(self.angle / 2)
        if kind == 'euler':  # the same, and turned further by what is set
            roll, pitch, yaw = (float(self.get_parameter(name).value) for name in OFFSETS)
            return quaternion_from_euler(roll, pitch, self.angle + yaw)
        return 0.0, 0.0, 0.0, 1.0


def problem(parameter: Parameter) -> Optional[str]:
    """Tell what is wrong with the value of a parameter, or None where nothing is."""
    value = parameter.value
    if parameter.name == 'rotation' and value not in ROTATIONS:
        return f'rotation must be one of {", ".join(ROTATIONS)}, got {value!r}'
    if parameter.name in OFFSETS and not (
            isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)):
        return f'{parameter.name} must be a finite number (rad), got {value!r}'
    return None


def command(*, ros_args: Sequence[str] = ()) -> int:
    """Run the node until it is told to stop; give the exit code."""
    return run_node(DynamicTfPublisher, ros_args)


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command; see `--help`."""
    return run(Parser(
        'dynamic_tf_publisher', 'Publish map -> moving_frame on /tf, ten times a second: a circle '
        'of 1 m about map, until Ctrl-C.',
        'parameters, which can be set while it runs, too:\n'
        '  rotation          identity (default), quaternion (about z, by the angle on the\n'
        '                    circle) or euler (the same, with the offsets)\n'
        '  roll, pitch, yaw  offsets of euler (rad; default 0)\n\n'
        'example: dynamic_tf_publisher --ros-args -p rotation:=euler -p roll:=0.5'), command, args)
