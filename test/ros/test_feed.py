"""The frames on /tf and /tf_static, as the web page reads them."""

import pytest
from rclpy.node import Node
from ros_node import stamped

from dummy_arm.tf import TransformBroadcaster
from dummy_arm.view.feed import LiveFeed, Publication


@pytest.fixture
def publication(ros):
    """Return a function that publishes a frame by several nodes until its delay is known."""
    nodes: list[Node] = []

    def publication(*names):
        nodes.extend(Node(name, context=ros.context) for name in names)
        broadcasters = [TransformBroadcaster(node) for node in nodes]
        feed = LiveFeed(ros.node)

        def send():
            now = ros.node.get_clock().now().nanoseconds
            for broadcaster in broadcasters:
                broadcaster.sendTransform(stamped('map', 'robot', now))

        def is_measured():
            frames = feed.buffer.frames()
            found.extend(map(feed.publication, frames))
            return found and found[-1].rate is not None

        found: list[Publication] = []
        ros.node.create_timer(0.02, send)
        ros.until(is_measured)
        return found[-1]

    yield publication
    for node in nodes:
        node.destroy_node()


def test_a_frame_of_two_nodes(publication):
    """Both are named, and that there is more than one."""
    assert publication('a', 'b').publisher == '/a and /b (more than one publisher)'


def test_two_viewers_look_at_two_frames(ros):
    """The rate of each frame is measured, although they are asked for in turn."""
    feed = LiveFeed(ros.node)
    broadcaster = TransformBroadcaster(ros.node)

    def send():
        now = ros.node.get_clock().now().nanoseconds
        broadcaster.sendTransform([stamped('map', name, now) for name in ('one', 'two')])

    ros.node.create_timer(0.02, send)
    ros.until(lambda: (frames := feed.buffer.frames()) and all(
        each.rate is not None for each in map(feed.publication, frames)))


def test_a_middleware_that_does_not_report_gids(handles, publication):
    """The rate and the delay are those of all publishers of the topic."""
    found = publication('a', 'b')
    assert found.publisher == 'one of /a, /b'
    assert found.rate is not None
    assert found.delay is not None
