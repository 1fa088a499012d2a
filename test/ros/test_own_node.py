"""Listeners where a private part of rclpy is not as expected: they have a node of their own."""

from math import inf
import re

from endings import end_in_every_order, without_library_lines
import pytest
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from rclpy.time import Time
from ros_node import eventually, stamped
from std_msgs.msg import String

from puretf import (
    Buffer,
    StaticTransformBroadcaster,
    TransformBroadcaster,
    TransformListener,
)
from puretf._ros import own_node, rclpy_private
from puretf._text.distribution import rclpy_version
from puretf.publisher_listener import (
    PublisherListener,
    ReceivedMessage,
    TopicReader,
    TransformSampler,
    UNKNOWN,
)

LATEST, WAIT = Time(), Duration(seconds=10.0)


@pytest.fixture(autouse=True)
def without_a_part(monkeypatch):
    """Let the probe of a private part fail."""
    monkeypatch.setitem(rclpy_private._PARTS, 'the compiled WaitSet', lambda: False)
    for function in rclpy_private.missing_part, own_node._warn_once:
        function.cache_clear()
    yield
    monkeypatch.undo()
    rclpy_private.missing_part.cache_clear()


@pytest.fixture
def remapped(make_node):
    """A node that nobody spins, in a namespace and with another topic for /tf."""
    return make_node('robot', namespace='/a', cli_args=['--ros-args', '-r', '/tf:=/other'])


def own_nodes(node):
    return [name for name in node.get_node_names() if name.endswith('_tf')]


@pytest.mark.parametrize('name', rclpy_private._PARTS)
def test_each_part_may_be_missing(ros, monkeypatch, capfd, name):
    """The probe may fail; one line says what is missing."""
    monkeypatch.setattr(rclpy_private, '_PARTS', {name: lambda: 1 / 0})
    for _ in range(2):
        TransformListener(Buffer(), ros.node).unregister()
    (line,) = re.findall('differs from .*', capfd.readouterr().err)
    assert line.startswith(f'differs from 7.1 and 9.1 in {name}. So transforms ')


# rclpy 9 cannot be imported itself without a WaitSet.
@pytest.mark.parametrize('name', ['EventHandle', *['WaitSet'] * rclpy_version().startswith('7.')])
def test_a_class_may_be_gone(start, name):
    """Importing this package needs none of them."""
    process = start('-c', f"""
from rclpy.impl.implementation_singleton import rclpy_implementation
del rclpy_implementation.{name}
import puretf.publisher_listener
from puretf._ros.rclpy_private import missing_part
print(missing_part())""")
    assert process.exit_code() == 0, process.output
    assert process.output == f'the compiled {name}\n'


def test_a_listener(ros, make_node, remapped):
    """Remapping applies; the listener and its node end with the node of the user."""
    buffer = Buffer(node=remapped)
    listener = PublisherListener(buffer, remapped)
    other = make_node('sender', cli_args=['--ros-args', '-r', '/tf:=/other'])
    broadcaster = TransformBroadcaster(other)
    future = buffer.wait_for_transform_async('map', 'tool', LATEST)
    StaticTransformBroadcaster(other).sendTransform(stamped('arm', 'tool'))
    eventually(broadcaster.pub_tf.get_subscription_count)
    broadcaster.sendTransform(stamped('map', 'arm', 5))
    found = buffer.lookup_transform('map', 'tool', LATEST, WAIT)
    assert Time.from_msg(found.header.stamp).nanoseconds == 5
    eventually(future.done)
    assert {frame.authority for frame in listener.frames()} == {
        UNKNOWN if rclpy_version().startswith('7.') else '/sender'}
    assert own_nodes(ros.node) == ['robot_tf']
    remapped.destroy_node()
    eventually(lambda: not own_nodes(ros.node))
    with pytest.raises(Exception, match='nothing'):
        buffer.lookup_transform('map', 'nothing', LATEST)


@pytest.mark.parametrize('where', ['main', 'executor', 'thread'])
def test_every_order_of_ending(domain_id, capfd, where):
    """As of another listener."""
    end_in_every_order(domain_id, where)
    assert [line for line in without_library_lines(capfd.readouterr().err).splitlines()
            if 'differs from 7.1 and 9.1' not in line] == []


def test_other_readers(ros):
    """A reader and a sampler take what has arrived; their nodes end with them."""
    publisher = ros.node.create_publisher(String, 'text', 1)
    reader = TopicReader(ros.node, String, 'text', 1)
    eventually(publisher.get_subscription_count)
    publisher.publish(String(data='good'))
    taken: list[list[ReceivedMessage]] = []

    def take():
        taken.append(reader.take())
        return any(taken)

    eventually(take)
    assert [message for each in taken for message in each] == [
        serialize_message(String(data='good'))]
    reader.close()
    broadcaster = StaticTransformBroadcaster(ros.node)
    broadcaster.sendTransform(stamped('map', 'base'))
    sampler, dynamic = TransformSampler(ros.node, []), TransformBroadcaster(ros.node)

    def heard(since=0.0):
        dynamic.sendTransform(stamped('base', 'tool'))
        sampler.poll()
        return sorted(child for each in sampler.heard(since) for child in each.parents)

    eventually(lambda: heard() == ['base', 'tool'])
    assert heard(since=inf) == ['base']  # it is latched
    sampler.close()
    assert own_nodes(ros.node) == []
