"""The node that publishes the transforms of a robot: `RobotStatePublisher`."""

from copy import copy
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, qos_profile_sensor_data, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from puretf import SECOND, StaticTransformBroadcaster, Transform, TransformBroadcaster
from puretf._causes.facts import listed
from puretf._text.names import quoted, shortened
from puretf.publisher_listener import nodes_on
from puretf_tools.inspection.joint_states import JointStateReader
from puretf_tools.robot.description import parse
from puretf_tools.robot.robot_transforms import LinkTransform, RobotTransforms

#: The time (s) after which joints without a position are named.
PATIENCE = 5.0
#: The largest number of warnings about one description.
_MAX_WARNINGS = 10


class RobotStatePublisher(Node):
    """
    A node with the parameters, topics and answers of robot_state_publisher 3.3.3.

    It publishes fixed joints on /tf_static, the joints that messages on joint_states name on /tf,
    and the description on robot_description.
    """

    def __init__(self, robot_description: str = '', **kwargs: Any) -> None:
        """
        Start publishing.

        :param robot_description: the URDF text; the parameter of this name takes precedence.
        :param kwargs: the arguments of `rclpy.node.Node` except the name.
        :raises DescriptionError: if the description is not valid.
        :raises ValueError: if publish_frequency is not valid.
        """
        super().__init__('robot_state_publisher', **kwargs)
        text = self.declare_parameter('robot_description', robot_description).value
        # With dynamic typing, integers are accepted, too.
        self.declare_parameter('publish_frequency', 20.0, ParameterDescriptor(dynamic_typing=True))
        self.declare_parameter('frame_prefix', '')
        self.declare_parameter('ignore_timestamp', False)
        _check_frequency(self.get_parameter('publish_frequency').value)
        self._description = parse(text)
        self._transforms = RobotTransforms(
            self._description, self.get_logger().warning, self._state_publishers)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._text_publisher = self.create_publisher(String, 'robot_description', latched)
        overrides = QoSOverridingOptions.with_default_policies()
        self._tf = TransformBroadcaster(self, qos_overriding_options=overrides)
        self._tf_static = StaticTransformBroadcaster(self, qos_overriding_options=overrides)
        self._patience = self.create_timer(
            PATIENCE, self._warn_of_missing, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._apply([*self.get_parameters(
            ['publish_frequency', 'frame_prefix', 'ignore_timestamp', 'robot_description'])])
        self.add_on_set_parameters_callback(self._check)
        self.add_post_set_parameters_callback(self._apply)
        self._states = self.create_subscription(
            JointState, 'joint_states', self._answer,
            copy(qos_profile_sensor_data),  # overrides change it
            qos_overriding_options=overrides, raw=True)
        self._reader = JointStateReader(self, self._states.topic_name)

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            try:
                if parameter.name == 'publish_frequency':
                    _check_frequency(parameter.value)
                elif parameter.name == 'robot_description':
                    self._description = parse(parameter.value)
            except ValueError as error:
                self.get_logger().warning(f'refused {parameter.name}: {error}')
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        names, transforms = {parameter.name for parameter in parameters}, self._transforms
        for parameter in parameters:
            if parameter.name in ('publish_frequency', 'frame_prefix', 'ignore_timestamp'):
                setattr(transforms, parameter.name, parameter.value)
        if 'robot_description' in names:
            transforms.set_description(self._description)
            self._text_publisher.publish(String(data=self._description.text))
            self._warn_of_description()
            self.get_logger().info('Robot initialized')
            self._patience.reset()
        if not names.isdisjoint(('robot_description', 'frame_prefix')):
            self._tf_static.replace(
                _messages(transforms.fixed(), self.get_clock().now().to_msg()))

    def _answer(self, data: Any) -> None:
        if (states := self._reader.read(data)) is None:
            return
        stamp = states.header.stamp
        transforms = self._transforms.moving(stamp.sec * SECOND + stamp.nanosec, states.name,
                                        states.position, self.get_clock().now().nanoseconds)
        if transforms is not None:
            self._tf.sendTransform(_messages(transforms, stamp))

    def _state_publishers(self) -> str:
        topic = self._states.topic_name
        names = nodes_on(self, topic)
        return f'; publishers of {shortened(topic)}: {listed(names)}' if names else ''

    def _warn_of_description(self) -> None:
        warnings = [*self._description.warnings, *(
            f'joint {quoted(joint.name)} is planar: it is published as a fixed joint'
            if joint.kind == 'planar' else
            f'joint {quoted(joint.name)} is floating: another program must publish its transform '
            f'{quoted(joint.parent)} -> {quoted(joint.child)}'
            for joint in self._description.joints if joint.kind in ('planar', 'floating'))]
        for warning in warnings[:_MAX_WARNINGS]:
            self.get_logger().warning(warning)
        if len(warnings) > _MAX_WARNINGS:
            self.get_logger().warning(f'and {len(warnings) - _MAX_WARNINGS} more warnings')

    def _warn_of_missing(self) -> None:
        self._patience.cancel()
        if warning := self._transforms.missing():
            self.get_logger().warning(warning)


def _check_frequency(value: Any) -> None:
    if type(value) not in (int, float) or not 0.0 <= value <= 1000.0:
        raise ValueError(f'publish_frequency must be between 0 and 1000 (Hz), got {value!r}')


def _messages(transforms: list[LinkTransform], stamp: Time) -> list[TransformStamped]:
    messages = [Transform(0, parent, child, pose[:3], pose[3:]).to_message()
                for parent, child, pose in transforms]
    for message in messages:
        message.header.stamp = stamp  # as it is, also if nanosec is larger than a second
    return messages
