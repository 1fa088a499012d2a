"""What hints may use of the clock and the ROS graph of a node."""

from collections.abc import Iterator, Sequence

from rclpy.clock import Clock, ROSClock
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from dummy_arm.tf._core.hints import Publisher, Surroundings
from dummy_arm.tf._core.texts import full_name, TF_MESSAGE
from dummy_arm.tf._ros.rclpy_private import GID_SIZE

#: The name of a publisher whose node is not known.
UNKNOWN = 'unknown publisher'
#: The node name that rmw reports for a publisher whose node is not discovered yet.
_UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'


def gid_of(info: TopicEndpointInfo) -> str:
    """Return the gid (in hex) of a publisher in the ROS graph."""
    return bytes(info.endpoint_gid[:GID_SIZE]).hex()


def node_of(info: TopicEndpointInfo) -> str:
    """Return the full name of a publisher's node; UNKNOWN if it is not discovered yet."""
    return (UNKNOWN if info.node_name == _UNKNOWN_NODE
            else full_name(info.node_namespace, info.node_name))


def clock_surroundings(clock: Clock) -> Surroundings:
    return Surroundings(
        clock.now().nanoseconds, isinstance(clock, ROSClock) and clock.ros_time_is_active)


def surroundings(node: Node, topics: Sequence[str], is_volatile: bool, is_fed: bool
                 ) -> Surroundings:
    """
    Return the surroundings of a listener.

    :param topics: of static transforms, and of dynamic ones.
    :param is_fed: whether transforms arrive, so that other topics need not be searched.
    """
    publishers = [
        Publisher(node_of(info), topic, info.topic_type,
                  info.qos_profile.durability == DurabilityPolicy.VOLATILE, gid_of(info))
        for topic in topics for info in node.get_publishers_info_by_topic(topic)]
    is_fed = is_fed or any(
        each.topic == topics[-1] and each.type == TF_MESSAGE for each in publishers)
    return clock_surroundings(node.get_clock())._replace(
        topics=topics, publishers=publishers, is_volatile=is_volatile,
        other_topics=() if is_fed else [*dict.fromkeys(_other_topics(node, topics))])


def _other_topics(node: Node, topics: Sequence[str]) -> Iterator[str]:
    for topic, types in sorted(node.get_topic_names_and_types()):
        if TF_MESSAGE in types and topic not in topics and node.count_publishers(topic):
            yield topic.removesuffix('_static')
