"""The joints that viewers move: their states are published, or a node is told to hold them."""

from collections.abc import Mapping, Sequence
from time import monotonic
from typing import TYPE_CHECKING

from puretf._causes.facts import listed, UNKNOWN
from puretf._text.names import shortened
from puretf_tools.cli.parser import UsageError
from puretf_tools.robot.description import Description
from puretf_tools.robot.joint_positions import JointPositions
from puretf_tools.robot.observed import DescriptionOrWhy, JOINT_STATE, joint_states_of, TOPIC

if TYPE_CHECKING:
    from rclpy.node import Node
    from sensor_msgs.msg import JointState

#: The time between two looks at the nodes in the network (s).
_PERIOD = 1.0
#: After a viewer has moved a joint, its reported positions do not count for this time (s).
_PATIENCE = 1.0
#: The largest number of nodes that viewers can command.
_MOST = 20


class JointControl:
    """The joints of one robot, which viewers move."""

    can_wave = False  #: whether the robot can move by itself

    def __init__(self, topic: str, description: Description) -> None:
        self.topic = topic
        self.positions = JointPositions(description)

    def set_description(self, description: Description) -> None:
        """Take a new description; the joints stay where they are."""
        if description is not self.positions.description:
            self.positions = JointPositions(description, self.positions.all())

    def set(self, name: str, position: float) -> None:
        """Move a joint (rad or m)."""
        if name in self.positions.free:
            self.positions.set(name, position)
            self._hold(name)

    def centre(self) -> None:
        self.positions.centre()
        self._hold(*self.positions.free)

    def wave(self) -> None:
        """Let the robot move by itself."""

    def _hold(self, *names: str) -> None:
        """Tell the robot to hold some joints where they are, and no others."""


class JointControls:
    """The robots whose joints viewers can move; which there are is looked up once a second."""

    controls: Sequence[JointControl] = ()
    why_none = ''  #: why there is no control, and what to do
    warning = ''  #: what is wrong with the controls
    come_first = False  #: whether the sliders are in the first tab
    _next = 0.0

    def update(self, descriptions: Mapping[str, DescriptionOrWhy]) -> None:
        """Follow the robots; `descriptions`: those in the network, by topic."""
        if monotonic() >= self._next:
            self._next = monotonic() + _PERIOD
            self._look(descriptions)

    def _look(self, descriptions: Mapping[str, DescriptionOrWhy]) -> None:
        """Look up which robots there are."""


class JointStatePublisher(JointControls):
    """Publishes the positions of all movable joints of one robot on joint_states."""

    come_first = True

    def __init__(self, node: 'Node') -> None:
        """
        Start; the description is that on the topic robot_description.

        :raises UsageError: if the parameter `rate` is invalid.
        """
        from rcl_interfaces.msg import ParameterDescriptor
        from sensor_msgs.msg import JointState
        # With dynamic typing, an integer is accepted, too.
        rate = node.declare_parameter('rate', 10.0, ParameterDescriptor(
            dynamic_typing=True, read_only=True, description='rate of the messages (Hz)')).value
        if type(rate) not in (int, float) or not 0.1 <= rate <= 1000.0:
            raise UsageError(f'rate must be a number from 0.1 to 1000 Hz, got {rate!r}')
        self._node = node
        self._publisher = node.create_publisher(JointState, 'joint_states', 10)
        self._source = node.resolve_topic_name(TOPIC)
        self.why_none = (
            f'No robot description has arrived on {shortened(self._source)}: start '
            'robot_state_publisher FILE, or pass FILE to joint_state_publisher, too.')
        node.create_timer(1.0 / rate, self._publish)

    def _look(self, descriptions: Mapping[str, DescriptionOrWhy]) -> None:
        from puretf.publisher_listener import nodes_on
        found = descriptions.get(self._source)
        if isinstance(found, str):
            self.why_none = found
        elif found:
            self.controls = self.controls or [JointControl(self._publisher.topic_name, found)]
            self.controls[0].set_description(found)
        topic, before = self._publisher.topic_name, self.warning
        others = {*nodes_on(self._node, topic)} - {self._node.get_fully_qualified_name(), UNKNOWN}
        self.warning = (
            f'{listed(sorted(others))} publishes on {shortened(topic)}, too: '
            'robot_state_publisher takes both, so the robot jumps. End one of the publishers.'
            ) if others else ''
        if self.warning and not before:
            self._node.get_logger().warning(self.warning)

    def _publish(self) -> None:
        for control in self.controls:
            self._publisher.publish(_message(self._node, control.positions.all()))


class JointCommander(JointControl):
    """Tells a node which joints to hold; shows the joint states of its robot."""

    can_wave = True

    def __init__(self, node: 'Node', topic: str, states: str, description: Description) -> None:
        from sensor_msgs.msg import JointState

        from puretf.publisher_listener import TopicReader
        from puretf_tools.inspection.joint_states import JointStateReader
        super().__init__(topic, description)
        self._node = node
        #: When the reported positions count again, by joint (s, monotonic clock).
        self._next: dict[str, float] = {}
        self._publisher = node.create_publisher(JointState, topic, 10)
        self._states = TopicReader(node, JointState, states, 1)
        self._reader = JointStateReader(node, self._states.topic)

    def close(self) -> None:
        self._node.destroy_publisher(self._publisher)
        self._states.close()

    def take_reported(self) -> None:
        """Take the positions that the robot has reported last."""
        now = monotonic()
        for state in filter(None, map(self._reader.read, self._states.take())):
            for name, position in zip(state.name, state.position):
                if now >= self._next.get(name, 0.0):
                    self.positions.set(name, position)

    def wave(self) -> None:
        self._next.clear()
        self._hold()

    def _hold(self, *names: str) -> None:
        self._next.update(dict.fromkeys(names, monotonic() + _PATIENCE))
        self._publisher.publish(
            _message(self._node, {name: self.positions[name] for name in names}))


class JointCommanders(JointControls):
    """The nodes that listen to a topic joint_command."""

    why_none = ('No node listens to a topic joint_command. To move the joints of a robot, start '
                'joint_state_publisher FILE; its own page has the sliders.')

    def __init__(self, node: 'Node') -> None:
        self._node = node
        #: By topic, and that of the robot's description.
        self._commanders: dict[tuple[str, str], JointCommander] = {}

    def update(self, descriptions: Mapping[str, DescriptionOrWhy]) -> None:
        super().update(descriptions)
        for commander in self._commanders.values():
            commander.take_reported()

    def _look(self, descriptions: Mapping[str, DescriptionOrWhy]) -> None:
        before, self._commanders = self._commanders, {}
        for topic, types in sorted(self._node.get_topic_names_and_types()):
            # The robot is that of the nearest namespace with a description.
            robot = max((name for name in descriptions if topic.startswith(
                name.removesuffix(TOPIC))), key=len, default='')
            description = descriptions.get(robot)
            if (isinstance(description, Description) and topic.endswith('/joint_command')
                    and JOINT_STATE in types and self._node.count_subscribers(topic)
                    and len(self._commanders) < _MOST):
                commander = before.pop((topic, robot), None) or JointCommander(
                    self._node, topic, joint_states_of(robot), description)
                commander.set_description(description)
                self._commanders[topic, robot] = commander
        for commander in before.values():
            commander.close()
        self.controls = [*self._commanders.values()]


def _message(node: 'Node', positions: dict[str, float]) -> 'JointState':
    from sensor_msgs.msg import JointState
    message = JointState(name=[*positions], position=[*positions.values()])
    message.header.stamp = node.get_clock().now().to_msg()
    return message
