"""
The node `dummy_arm`: publish the transforms, the joint angles and the URDF of an arm that waves.

This node is the final task of the course.
"""

from collections.abc import Sequence
from functools import partial
from importlib.resources import files
from itertools import pairwise
import math
from typing import Any, NamedTuple, Optional

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from dummy_arm.arm import OFFSETS, poses, Wave
from dummy_arm.grading.sheet import FRAMES, JOINTS
from puretf import PreparedTransforms, StaticTransformBroadcaster, Transform, TransformBroadcaster
from puretf._text.names import comma_list, quoted, shortened
from puretf._text.similar_names import suggest_names
from puretf_tools.cli.node import run_node
from puretf_tools.cli.parser import add_namespace_option, Parser, run
from puretf_tools.inspection.joint_states import JointStateReader

PREFIX = 'frame_prefix'
#: The default and the meaning of the parameters that cannot be changed.
READ_ONLY: dict[str, tuple[Any, str]] = {
    PREFIX: ('', 'prefix for the name of every frame except map; read-only'),
    'publish_tf': (True, 'send all frames but base_link on /tf; read-only'),
    'publish_joint_states': (True, 'send the joint angles on joint_states; read-only'),
    'publish_description': (True, 'send the URDF of the arm on robot_description; read-only')}


class Quantity(NamedTuple):
    """A numeric parameter."""

    default: float
    smallest: float
    largest: float
    unit: str
    meaning: str


#: The numeric parameters, by name.
QUANTITIES = {'rate': Quantity(50.0, 0.1, 10000.0, 'Hz', 'rate of the messages')}
for joint, offset in zip(JOINTS, OFFSETS):
    QUANTITIES |= {
        f'{joint.name}.speed': Quantity(
            joint.speed, -100.0, 100.0, 'rad/s', f'speed of the phase of {joint.name}'),
        f'{joint.name}.limit': Quantity(
            joint.limit, 0.0, math.pi, 'rad', f'{joint.name} rotates between -limit and limit'),
        f'{joint.name}.offset': Quantity(
            offset, -100.0, 100.0, 'm', f'distance of {joint.name} from its parent frame')}


def command_problem(command: JointState, limits: dict[str, float]) -> Optional[str]:
    """
    Return why a command is invalid; None if it is valid.

    :param limits: the limit of each joint (rad).
    """
    if len(command.name) != len(command.position):
        names = comma_list(command.name, shortened) or 'none'
        return (f'it has {len(command.position)} positions for {len(command.name)} joints '
                f'({names}); each joint needs one')
    for name, position in zip(command.name, command.position):
        if name not in limits:
            return (f'there is no joint {quoted(name)}. '
                    f'{suggest_names(name, tuple(limits), "joints")}')
        if not abs(position) <= limits[name]:  # NaN, too
            return (f'{name} must be at an angle from {-limits[name]} to {limits[name]} rad, '
                    f'got {position}')
    return None


class DummyArm(Node):
    """
    A node that publishes map -> base_link on /tf_static, and the rest of the arm on /tf.

    It also publishes the joint angles and the URDF of the arm. Joints that are named in a message
    on ~/joint_command are held at its positions; after a message without names, all joints wave.
    """

    def __init__(self) -> None:
        """Start publishing, or raise ParameterException: the value of a parameter is invalid."""
        super().__init__('dummy_arm')
        self.add_on_set_parameters_callback(self._check)
        for name, quantity in QUANTITIES.items():
            # Dynamic typing accepts integers, too; `_check` checks the value.
            self.declare_parameter(name, quantity.default, ParameterDescriptor(
                dynamic_typing=True, description=f'{quantity.meaning} ({quantity.unit})'))
        for name, (default, meaning) in READ_ONLY.items():
            self.declare_parameter(name, default, ParameterDescriptor(
                read_only=True, description=meaning))
        self._waves = {joint.name: Wave(
            self._value(f'{joint.name}.speed'), self._value(f'{joint.name}.limit'))
            for joint in JOINTS}
        self._start_ns: Optional[int] = None

        root, *frames = FRAMES
        frames = [self._value(PREFIX) + frame for frame in frames]
        self._static = StaticTransformBroadcaster(self)
        self._static.sendTransform(Transform(
            self.get_clock().now().nanoseconds, root, frames[0]).to_message())
        self._published = [f'{root} -> {shortened(frames[0])} on {self._static.pub_tf.topic_name}']
        self._transforms: Optional[PreparedTransforms] = None
        if self._value('publish_tf'):
            broadcaster = TransformBroadcaster(self)
            self._transforms = broadcaster.prepare(list(pairwise(frames)))
            self._published.append(
                f'{" -> ".join(map(shortened, frames))} on {broadcaster.pub_tf.topic_name}')
        self._angles: Optional[Publisher] = None
        self._state = JointState(name=[*self._waves])
        if self._value('publish_joint_states'):
            self._angles = self.create_publisher(JointState, 'joint_states', 10)
            self._published.append(f'joint angles on {self._angles.topic_name}')
        if self._value('publish_description'):
            self._description = self.create_publisher(String, 'robot_description', QoSProfile(
                depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
            urdf = files('dummy_arm').joinpath('urdf/dummy_arm.urdf')
            self._description.publish(String(data=urdf.read_text(encoding='utf-8')))
        self._refused = ''  # why the last message was refused, without numbers
        self._commands = self.create_subscription(
            JointState, '~/joint_command', self._obey, 10, raw=True)
        self._reader = JointStateReader(self, self._commands.topic_name)
        self._timer = self.create_timer(1.0 / self._value('rate'), self._tick)
        if self._value('use_sim_time'):
            self.get_logger().info('use_sim_time is true: waiting for a message on /clock')
        self.add_post_set_parameters_callback(self._apply)

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            name, value, expected = parameter.name, parameter.value, ''
            quantity = QUANTITIES.get(name)
            if quantity and not (type(value) in (int, float)
                                 and quantity.smallest <= value <= quantity.largest):
                expected = (f'a number from {quantity.smallest:g} to {quantity.largest:g} '
                            f'{quantity.unit}')
            if name == PREFIX and value.startswith('/'):
                expected = 'a name that does not begin with /'
            if expected:
                return SetParametersResult(
                    successful=False, reason=f'{name} must be {expected}, got {value!r}')
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        t = self._seconds(self.get_clock().now().nanoseconds)
        for parameter in parameters:
            name, _, quantity = parameter.name.partition('.')
            if name == 'rate':
                self._timer.timer_period_ns = round(1e9 / parameter.value)
                self._timer.reset()
            elif quantity == 'speed':
                self._waves[name] = self._waves[name].with_speed(parameter.value, t)
            elif quantity == 'limit':
                self._waves[name] = self._waves[name].with_limit(parameter.value, t)

    def _obey(self, data: Any) -> None:
        if (command := self._reader.read(data)) is None:
            return
        problem = command_problem(
            command, {name: wave.limit for name, wave in self._waves.items()})
        cause, _, _ = (problem or '').partition(', got')
        if problem and cause != self._refused:
            self.get_logger().warning(
                f'refused a message on {self._commands.topic_name}: {problem}')
        self._refused = cause  # is not logged again
        if problem:
            return
        t = self._seconds(self.get_clock().now().nanoseconds)
        for name, position in zip(command.name, command.position):
            self._waves[name] = self._waves[name].with_hold(position)
        if not command.name:
            self._waves = {name: wave.with_release(t) for name, wave in self._waves.items()}

    def _seconds(self, time_ns: int) -> float:
        """Return the time from the first tick to `time_ns` (s); 0 before the first tick."""
        return 0.0 if self._start_ns is None else (time_ns - self._start_ns) * 1e-9

    def _tick(self) -> None:
        now_ns = self.get_clock().now().nanoseconds
        if self._start_ns is None:
            self._start_ns = now_ns
            self.get_logger().info(
                f'publishing {", ".join(self._published)} at {self._value("rate"):g} Hz; '
                f't = 0 at {now_ns} ns')
        t = self._seconds(now_ns)
        angles = [wave.angle(t) for wave in self._waves.values()]
        if self._transforms:
            offsets = [self._value(f'{joint.name}.offset') for joint in JOINTS]
            self._transforms.send(now_ns, poses(angles, offsets))
        if self._angles:
            self._state.header.stamp = Time(nanoseconds=now_ns).to_msg()
            self._state.position = angles
            self._angles.publish(self._state)


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the node; see `--help`. Return the exit code."""
    lines = [f'  {name:20} {quantity.meaning} ({quantity.unit}; {quantity.smallest:g} to '
             f'{quantity.largest:g}; default {quantity.default:g})'
             for name, quantity in QUANTITIES.items()]
    lines += [f'  {name:20} {meaning} (default {str(default).lower() or "empty"})'
              for name, (default, meaning) in READ_ONLY.items()]
    parser = Parser(
        'dummy_arm',
        description='Publish the transforms of a small arm that waves, until Ctrl-C: map -> '
                    'base_link\non /tf_static, base_link -> joint_1 -> joint_2 -> joint_3 -> '
                    'end_effector on /tf.\nThe joint angles are on joint_states, and the URDF of '
                    'the arm is on robot_description.\nA message on ~/joint_command '
                    '(sensor_msgs/JointState) holds the joints that it names at\nits positions '
                    '(rad); a message without names lets all joints wave again.',
        epilog='\n'.join((
            'parameters, set by --ros-args -p NAME:=VALUE:', *lines,
            '  use_sim_time         take the time from /clock (default false)',
            '', 'example: dummy_arm --ros-args -p rate:=100 -p joint_1.speed:=1.0')))
    add_namespace_option(parser, 'publish on', 'tf', 'tf_static', 'joint_states',
                         'robot_description')
    return run(parser, partial(run_node, DummyArm), args)
