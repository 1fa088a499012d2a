"""The PublisherListener, over DDS: which node has published a transform."""

import time
from types import SimpleNamespace
from typing import Any

from processes import TIMEOUT
import pytest
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from rclpy.time import Time
from rclpy.topic_endpoint_info import TopicEndpointInfo
from ros_node import eventually, stamped

from puretf import (
    Buffer,
    publisher_listener,
    StaticTransformBroadcaster,
    TFMessage,
    TransformBroadcaster,
)
from puretf._ros import topic_watch
from puretf._ros.subscription import SubscriptionSource
from puretf.publisher_listener import (
    node_of,
    PublisherListener,
    ReceivedMessage,
    UNKNOWN,
)

Publishers: Any = topic_watch.Publishers


def bytes_of(*transforms):
    """Return the bytes of a TFMessage."""
    return serialize_message(TFMessage(transforms=transforms))


@pytest.fixture
def listener(ros):
    """A listener that knows the publisher of each transform."""
    created = PublisherListener(Buffer(node=ros.node), ros.node)
    yield created
    created.unregister()


def publisher_of(listener, name):
    """Return the name of the node that has published a frame; UNKNOWN if there is none."""
    return {frame.name: frame.authority for frame in listener.frames()}.get(name, UNKNOWN)


def test_callbacks_cannot_be_overridden(ros):
    """Messages without gids would be of no use; nothing is left in the node."""
    class Own(PublisherListener):
        def callback(self, data):
            pass

    before = [*ros.node.subscriptions], [*ros.node.guards]
    for create in lambda: Own(Buffer(), ros.node), lambda: PublisherListener(object(), ros.node):
        with pytest.raises(TypeError, match='a PublisherListener needs a buffer'):
            create()
    assert ([*ros.node.subscriptions], [*ros.node.guards]) == before


def test_each_transform_is_of_the_node_that_sent_it(ros, make_node, listener):
    """The publisher is known while several nodes publish, and after it has ended."""
    other = make_node('other', namespace='/robot')
    StaticTransformBroadcaster(ros.node).sendTransform(stamped('map', 'a'))
    StaticTransformBroadcaster(other).sendTransform(stamped('map', 'b'))
    dynamic = [TransformBroadcaster(ros.node), TransformBroadcaster(other)]
    eventually(lambda: all(each.pub_tf.get_subscription_count() for each in dynamic))
    for stamp in range(1, 50):
        dynamic[0].sendTransform(stamped('map', 'c', stamp))
        dynamic[1].sendTransform(stamped('map', 'd', stamp))
    eventually(lambda: [publisher_of(listener, name) for name in 'abcd'] == [
        '/test', '/robot/other'] * 2)
    assert len(listener.present) == 4
    other.destroy_node()
    eventually(lambda: len(listener.present) == 2)
    assert publisher_of(listener, 'b') == '/robot/other'
    (gid,) = {frame.authority for frame in listener.buffer.frames() if frame.name == 'b'}
    assert listener.names_of([gid, 'none']) == {gid: '/robot/other', 'none': UNKNOWN}


def gid_of(listener, name):
    """Return the identifier of the publisher of a frame."""
    (gid,) = {frame.authority for frame in listener.buffer.frames() if frame.name == name}
    return gid


def test_cyclone_dds_is_asked_for_the_gids(ros, other, libddsc, listener):
    """With a handle in place of each gid, the publishers are known, also when they have ended."""
    for node, name in (ros.node, 'a'), (other, 'b'):
        StaticTransformBroadcaster(node).sendTransform(stamped('map', name))
    eventually(lambda: [publisher_of(listener, name) for name in 'ab'] == ['/test', '/other'])
    gids = {bytes(info.endpoint_gid)[:16].hex()
            for info in ros.node.get_publishers_info_by_topic('/tf_static')}
    assert {gid_of(listener, name) for name in 'ab'} == gids
    assert {message.publisher for message in listener.received().messages} == gids
    assert not libddsc.structs
    other.destroy_node()
    eventually(lambda: listener.is_present(gid_of(listener, 'b')) is False)
    assert publisher_of(listener, 'b') == '/other'
    assert listener.is_present(gid_of(listener, 'a'))


def test_a_publisher_that_ended_before_cyclone_dds_was_asked_is_unknown(
        ros, other, libddsc, listener):
    """It is not taken for the only publisher that exists."""
    libddsc.gids = {}
    StaticTransformBroadcaster(ros.node).sendTransform(stamped('map', 'a'))
    eventually(listener.frames)
    assert publisher_of(listener, 'a') == UNKNOWN
    assert listener.is_present(gid_of(listener, 'a')) is None


def test_without_gids_the_publisher_is_unknown(ros, handles, listener):
    """A number identifies each publisher, but it is not in the ROS graph."""
    StaticTransformBroadcaster(ros.node).sendTransform(stamped('map', 'a'))
    eventually(listener.frames)
    assert publisher_of(listener, 'a') == UNKNOWN
    gid = gid_of(listener, 'a')
    assert len(handles) == 1
    assert gid not in listener.present
    assert listener.is_present(gid) is None


class Graph:
    """A ROS graph in which nodes, each in a namespace of its own, publish on every topic."""

    numbers = range(0)

    def get_publishers_info_by_topic(self, topic):
        """Return the publishers."""
        return [SimpleNamespace(endpoint_gid=number.to_bytes(16, 'big'), node_name='node',
                                topic_type='', node_namespace=f'/{number}')
                for number in self.numbers]


def test_the_names_that_are_kept_are_bounded():
    """Names of existing publishers are kept, and of those that have ended so many as fit."""
    graph = Graph()
    publishers = Publishers(graph, ['/tf'])
    for begin in 0, 7000:
        graph.numbers = range(begin, begin + 7000)
        names = publishers.names_of(number.to_bytes(16, 'big').hex() for number in range(14_000))
    assert [name for name in names.values() if name != UNKNOWN].count('/13999/node') == 1
    assert sum(name != UNKNOWN for name in names.values()) == 10_000


def test_no_pause_where_the_time_of_reception_is_that_of_the_take(ros, handles, monkeypatch):
    """The thread takes all messages by itself, even if a listener otherwise pauses for long."""
    taken: list[bytes] = []
    of = ReceivedMessage.of

    def record(data, *args):
        taken.append(data)
        return of(data, *args)

    monkeypatch.setattr(ReceivedMessage, 'of', record)
    monkeypatch.setattr(SubscriptionSource, 'next_pause', lambda self: 1000.0)
    listener = PublisherListener(Buffer(node=ros.node), ros.node)
    publisher = TransformBroadcaster(ros.node).pub_tf
    eventually(publisher.get_subscription_count)
    for stamp in range(1, 6):
        publisher.publish(bytes_of(stamped('map', 'moving', stamp)))
        eventually(lambda: len(taken) == stamp)  # noqa: B023
    listener.unregister()


@pytest.fixture
def send(ros, listener):
    """Return a function that publishes a transform with a stamp (ns) and returns the message."""
    publisher = TransformBroadcaster(ros.node).pub_tf
    eventually(publisher.get_subscription_count)

    def send(stamp):
        message = bytes_of(stamped('map', 'moving', stamp))
        publisher.publish(message)
        return message

    return send


def has_arrived(listener, stamp):
    """Wait for a transform; return True if it and all earlier ones are in the buffer in time."""
    return listener.buffer.can_transform(
        'map', 'moving', Time(nanoseconds=stamp), Duration(seconds=TIMEOUT))


def test_received_messages_are_returned_once(ros, listener, send):
    """Messages keep their order, gid, time and topic, even if a lookup has pulled them before."""
    static = StaticTransformBroadcaster(ros.node)
    eventually(static.pub_tf.get_subscription_count)
    begin, sent, latched, messages = time.time_ns(), [], [], []
    for number in range(100, 150):
        sent.append(send(number))
        latched.append(stamped('map', f'still_{number}'))
        static.sendTransform(latched[-1])
        if number % 3:
            messages += listener.received().messages
        assert has_arrived(listener, number)
        listener.buffer.lookup_transform(
            'map', f'still_{number}', Time(), Duration(seconds=TIMEOUT))
    messages += listener.received().messages
    assert listener.received() == ([], 0)
    for topic, expected in (('/tf', sent), ('/tf_static', [
            bytes_of(*latched[:count]) for count in range(1, 51)])):
        of_topic = [message for message in messages
                    if message.is_static == (topic == '/tf_static')]
        # DDS need not deliver a latched message of depth 1 that the next one replaces.
        assert of_topic == [each for each in expected if each in of_topic or topic == '/tf']
        assert of_topic[-1] == expected[-1]
        (info,) = ros.node.get_publishers_info_by_topic(topic)
        assert {message.publisher for message in of_topic} == {bytes(info.endpoint_gid)[:16].hex()}
        times = [begin, *(message.time for message in of_topic), time.time_ns()]
        assert times == sorted(times)


def test_messages_from_before_the_end_are_received(listener, send):
    """`received` returns exactly the messages whose transforms are in the buffer."""
    sent = [send(stamp) for stamp in range(100, 150)]
    assert has_arrived(listener, 149)
    sent += [send(stamp) for stamp in range(150, 200)]
    listener.unregister()
    messages, dropped = listener.received()
    assert len(messages) >= 50
    assert (messages, dropped) == (sent[:len(messages)], 0)
    assert listener.buffer.dump()['moving']['stamps'] == [
        row.stamp_ns for message in messages for row in message.rows()]
    send(200)
    assert listener.received() == ([], 0)


def test_the_number_and_size_of_kept_messages_are_bounded(monkeypatch):
    """The newest messages are kept, and the number of those that were dropped."""
    messages = [ReceivedMessage(bytes([i] * 8)) for i in range(50)]
    for most_messages, most_bytes, number_kept in (
            (10, 1000, 10), (1000, 87, 10), (1000, 16, 2), (1000, 7, 0)):
        monkeypatch.setattr(publisher_listener, '_MOST_MESSAGES', most_messages)
        monkeypatch.setattr(publisher_listener, '_MOST_BYTES', most_bytes)
        kept = publisher_listener._Kept()
        for number in 25, 50, 1:
            kept.add(messages[:number - 1])
            kept.add(messages[number - 1:number])
            dropped = max(0, number - number_kept)
            assert kept.take() == (messages[dropped:number], dropped)
            assert kept.take() == ([], 0)


@pytest.mark.parametrize(('namespace', 'name', 'expected'), [
    ('/robot', 'arm', '/robot/arm'), ('/', 'arm', '/arm'),
    ('_NODE_NAMESPACE_UNKNOWN_', '_NODE_NAME_UNKNOWN_', 'unknown publisher')])
def test_the_node_of_an_endpoint(namespace, name, expected):
    """The placeholders are those of rmw for a node that is not discovered yet."""
    info = TopicEndpointInfo(node_namespace=namespace, node_name=name)
    assert node_of(info) == expected
