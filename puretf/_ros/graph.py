"""What the texts of errors use of the clock and the ROS graph of a node."""

from collections.abc import Callable, Sequence
from functools import partial
from inspect import currentframe
from traceback import walk_stack
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import ROSClock
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from puretf._causes.domains import described, other_user
from puretf._causes.facts import Blocked, Heard, Publisher, Surroundings, UNKNOWN
from puretf._ros.rclpy_private import GID_SIZE
from puretf._text.names import full_name, namespace_distance, TF_MESSAGE

if TYPE_CHECKING:  # of another module in rclpy 10
    from rclpy.topic_endpoint_info import TopicEndpointInfo

#: The node name that rmw reports for a publisher whose node is not discovered yet.
_UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'
#: By node: the child frames that its broadcasters of dynamic transforms have sent.
broadcast: WeakKeyDictionary[Node, set[str]] = WeakKeyDictionary()
#: The name of the type JointState.
JOINT_STATE = 'sensor_msgs/msg/JointState'


def gid_of(info: 'TopicEndpointInfo') -> str:
    """Return the gid (in hex) of a publisher in the ROS graph."""
    return bytes(info.endpoint_gid[:GID_SIZE]).hex()


def node_of(info: 'TopicEndpointInfo') -> str:
    """Return the full name of a publisher's node; UNKNOWN if it is not discovered yet."""
    return (UNKNOWN if info.node_name == _UNKNOWN_NODE
            else full_name(info.node_namespace, info.node_name))


def nodes_by_gid(node: Node, topic: str, type_name: str = '') -> dict[str, str]:
    """Return by gid the full names of the nodes that publish a type ('': any) on a topic."""
    return {gid_of(info): node_of(info) for info in node.get_publishers_info_by_topic(topic)
            if type_name in ('', info.topic_type)}


def nodes_on(node: Node, topic: str) -> list[str]:
    return sorted({*nodes_by_gid(node, topic).values()})


def surroundings(
        node: Node, subscriptions: Sequence[Subscription], has_data: bool, has_dynamic: bool,
        listen: Callable[[], Sequence[Heard]]) -> Surroundings:
    """
    Return the surroundings of a listener.

    :param subscriptions: to static transforms, and to dynamic ones.
    :param has_data: whether any transform has arrived.
    :param has_dynamic: whether a dynamic one has.
    """
    topics = [each.topic_name for each in subscriptions]
    publishers = [
        Publisher(node_of(info), each.topic_name, info.topic_type, gid_of(info),
                  _lack(info.qos_profile, each.qos_profile))
        for each in subscriptions for info in node.get_publishers_info_by_topic(each.topic_name)]
    is_fed = has_dynamic or (has_data and topics[-1] != '/tf') or any(
        each.topic == topics[-1] and each.type == TF_MESSAGE for each in publishers)
    clock, domain = node.get_clock(), node.context.get_domain_id()
    joint_topics = [topic for topic, types in node.get_topic_names_and_types()
                    if JOINT_STATE in types]
    nodes = {topic: nodes_on(node, topic) for topic in (*joint_topics, '/clock')}
    return Surroundings(
        clock.now().nanoseconds, isinstance(clock, ROSClock) and clock.ros_time_is_active,
        nodes['/clock'], topics, publishers,
        is_volatile=subscriptions[0].qos_profile.durability == DurabilityPolicy.VOLATILE,
        has_data=has_data, other_topics=[] if is_fed else [*dict.fromkeys(
            topic.removesuffix('_static') for topic in other_topics(node, topics))],
        listen=listen, waits_for={
            name: topic for topic in nodes if not nodes[topic]
            for info in node.get_subscriptions_info_by_topic(topic)
            if (name := node_of(info)) != UNKNOWN},
        joint_states={topic: nodes[topic] for topic in joint_topics if nodes[topic]},
        domain=partial(described, domain), other_user=partial(other_user, domain),
        node=node.get_fully_qualified_name())


def _lack(offered: QoSProfile, requested: QoSProfile) -> str:
    """Return what a publisher does not offer, but the listener requests; '' if they match."""
    if requested.durability == DurabilityPolicy.TRANSIENT_LOCAL != offered.durability:
        return 'transient local'
    if requested.reliability == ReliabilityPolicy.RELIABLE != offered.reliability:
        return 'reliable'
    return ''


def other_topics(node: Node, topics: Sequence[str]) -> list[str]:
    """Return the other topics with publishers of transforms: the nearest to the node first."""
    namespace = node.get_namespace()
    return sorted((topic for topic, types in node.get_topic_names_and_types()
                   if TF_MESSAGE in types and topic not in topics
                   and node.count_publishers(topic)), key=lambda topic: (
                       namespace_distance(topic.rpartition('/')[0], namespace), topic))


def blocked_nodes(node: Node) -> dict[str, Blocked]:
    """Return the nodes whose callbacks wait until this thread goes on, each with the reason."""
    nodes = [node]
    callers = [frame.f_locals for frame, _ in walk_stack(currentframe())
               if frame.f_globals.get('__name__') == 'rclpy.executors']
    executor = next((each['self'] for each in callers if isinstance(
        each.get('self'), Executor)), None)
    if not callers:
        # `rclpy.spin_once` removes the node from the executor, which stays that of the node.
        if node.executor is not None and node in node.executor.get_nodes():
            return {}
        why, remedy = 'cannot while nothing spins it', 'Spin it in a thread.'
    elif isinstance(executor, SingleThreadedExecutor):
        nodes = executor.get_nodes()
        why, remedy = 'cannot while this lookup blocks its executor', (
            'Await lookup_transform_async instead, in a callback group of its own.')
    else:
        group = next((each['entity'].callback_group for each in callers if 'entity' in each), None)
        if isinstance(group, ReentrantCallbackGroup) or {
                timer.callback_group for timer in node.timers} != {group}:
            return {}
        why, remedy = 'cannot while this lookup keeps its callback group busy', (
            'Put the callback that looks up into a group of its own.')
    return {each.get_fully_qualified_name(): Blocked(why, remedy, broadcast.get(each, ()))
            for each in nodes}
