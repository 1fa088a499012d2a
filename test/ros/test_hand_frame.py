"""The frame that is placed by hand, as the node of web_view publishes it."""


import pytest
from rclpy.time import Time
from ros_node import pose_of, stamped

from puretf import (
    Buffer,
    StaticTransformBroadcaster,
    Transform,
    TransformBroadcaster,
    TransformListener,
)
from puretf_tools.view.feed import LiveFeed

HAND = Transform(0, 'map', 'hand', (1.0, -2.5, 0.125), (0.5, 0.5, 0.5, 0.5))


@pytest.fixture
def feed(ros):
    """The feed of the page."""
    return LiveFeed(ros.node)


@pytest.fixture
def publisher(feed):
    """What publishes the frames of the viewers."""
    return feed.hand_publisher


def numbers(buffer, parent='map'):
    """Return the pose of 'hand' in the buffer of a listener."""
    return pose_of(buffer.lookup_transform(parent, 'hand', Time()))


ME, YOU = 'one viewer', 'another one'


def test_it_is_published_until_it_is_stopped(ros, publisher, other):
    """Late listeners receive it until then; those that have received it keep it."""
    early, later, late = (Buffer() for _ in range(3))
    TransformListener(early, other)
    assert not publisher.send(HAND, ME)
    ros.until(lambda: early.can_transform('map', 'hand', Time()))
    assert numbers(early) == [*HAND.translation, *HAND.rotation]
    moved = HAND._replace(translation=(0.0, 0.0, 0.0))
    assert not publisher.send(moved, ME)
    TransformListener(later, other)
    ros.until(lambda: later.can_transform('map', 'hand', Time()))
    ros.until(lambda: numbers(early) == numbers(later) == [0.0, 0.0, 0.0, *HAND.rotation])
    publisher.stop('hand')
    publisher.stop('hand')
    StaticTransformBroadcaster(other).sendTransform(stamped('map', 'post'))
    TransformListener(late, other)
    ros.until(lambda: late.can_transform('map', 'post', Time()))
    assert not late.can_transform('map', 'hand', Time())
    assert early.can_transform('map', 'hand', Time())
    assert not publisher.send(HAND._replace(frame_id='post'), ME)
    ros.until(lambda: late.can_transform('post', 'hand', Time()))
    ros.until(lambda: numbers(early, 'post') == [*HAND.translation, *HAND.rotation])


def test_two_viewers_publish_a_frame_each(ros, publisher, other):
    """When one stops, the frame of the other stays for late listeners."""
    assert not publisher.send(HAND, ME)
    assert not publisher.send(HAND._replace(child_frame_id='second'), ME)
    assert publisher.send(HAND, YOU) == 'another viewer publishes frame hand already'
    publisher.stop('second')
    late = Buffer()
    TransformListener(late, other)
    ros.until(lambda: late.can_transform('map', 'hand', Time()))
    assert not late.can_transform('map', 'second', Time())


@pytest.mark.parametrize('broadcaster', [StaticTransformBroadcaster, TransformBroadcaster])
def test_a_frame_of_another_node_is_refused(ros, feed, publisher, other, broadcaster):
    """The node is named; after its end, its frame can be published."""
    sender = broadcaster(other)

    def is_received():
        sender.sendTransform(stamped('map', 'hand', 1))
        return feed.buffer.frames()

    ros.until(is_received)
    ros.until(lambda: publisher.send(HAND, ME) == '/other publishes frame hand already')
    assert not publisher.send(HAND._replace(child_frame_id='new'), ME)
    other.destroy_node()
    ros.until(lambda: not publisher.send(HAND, ME))


def test_another_node_that_comes_later(ros, feed, publisher, other):
    """From then on, its frame is refused."""
    assert not publisher.send(HAND, ME)
    ros.until(feed.buffer.frames)
    assert not publisher.send(HAND, ME)
    StaticTransformBroadcaster(other).sendTransform(stamped('map', 'hand'))
    ros.until(lambda: publisher.send(HAND._replace(translation=(0.0, 0.0, 0.0)), ME)
              == '/other publishes frame hand already')


def test_a_middleware_that_does_not_report_gids(handles, ros, feed, publisher, other):
    """Its own frame can be moved; one that may be of another node is refused."""
    StaticTransformBroadcaster(other).sendTransform(stamped('map', 'base'))
    ros.until(feed.buffer.frames)
    assert not publisher.send(HAND, ME)
    ros.until(lambda: len(feed.buffer.frames()) == 2)
    assert not publisher.send(HAND._replace(translation=(0.0, 0.0, 0.0)), ME)
    assert 'unknown publisher publishes frame base' in publisher.send(
        HAND._replace(child_frame_id='base'), ME)
