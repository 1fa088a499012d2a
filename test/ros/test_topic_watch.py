"""Readers of the topics that are wanted, over DDS."""

from types import SimpleNamespace

from geometry_msgs.msg import PointStamped
from messages import ignore
import pytest
from rclpy.serialization import serialize_message
from ros_node import LATCHED, point
from std_msgs.msg import Empty, String

from puretf._ros import topic_watch
from puretf._wire import received_message
from puretf.publisher_listener import TopicReader, TopicWatch
from puretf_tools.inspection import header_sampler
from puretf_tools.inspection.header_sampler import HeaderSampler


@pytest.fixture(autouse=True)
def often(monkeypatch):
    """Let topics be searched for twenty times a second."""
    monkeypatch.setattr(topic_watch, '_SCAN_INTERVAL', 0.05)


@pytest.fixture
def watch(ros):
    """A function that watches topics for strings, with a limit of two topics."""
    created = []

    def watch(*topics):
        created.append(TopicWatch(ros.node, lambda: [(each, String) for each in topics], 2, 5))
        return created[0]

    yield watch
    created[0].close()


@pytest.mark.parametrize(('has_volatile', 'expected'), [
    (False, [('old', False), ('new', True)]),
    (True, [('new', False), ('new', True), ('old', False)])])
def test_latched_messages_and_new_ones(ros, watch, has_volatile, expected):
    """Of a message that both readers receive, one is new."""
    publisher = ros.node.create_publisher(String, '/words', LATCHED)
    publisher.publish(String(data='old'))
    if has_volatile:
        ros.node.create_publisher(String, '/words', 1)
    watched, taken = watch('/words'), []

    def take():
        watched.poll()
        taken.extend(watched.take('/words'))
        return len(taken)

    ros.until(lambda: take() == 1 and publisher.get_subscription_count() == 1 + has_volatile)
    publisher.publish(String(data='new'))
    ros.until(lambda: take() == len(expected))
    texts = {serialize_message(String(data=text)): text for text in ('old', 'new')}
    found = [(texts[message], is_new) for message, is_new in taken]
    assert (sorted(found) if has_volatile else found) == expected


def test_topics_are_left_and_read_again(ros, watch, capfd):
    """There are at most two; one that the node reads with another type is tried once."""
    ros.node.create_subscription(Empty, '/other', ignore, 1)
    watched = watch('/other', '/a', '/b')
    watched.poll()
    assert [(topic, [*readers]) for topic, readers in watched.readers.items()] == [
        ('/other', []), ('/a', [False])]
    ros.until(lambda: ros.node.count_subscribers('/a'))
    watched.leave('/a')
    ros.until(lambda: not ros.node.count_subscribers('/a'))
    ros.until(lambda: watched.poll() or '/b' in watched.readers or '/a' in watched.readers)
    assert [*watched.readers] == ['/other', '/a']
    assert capfd.readouterr().err.count('existing topic name rt/other with') <= 1


def test_times_of_arrival_that_the_middleware_does_not_report(ros, monkeypatch):
    """They are later than the sending by the shortest delay, and not before the last take."""
    now = sent = 0
    for module in topic_watch, received_message:
        monkeypatch.setattr(module, 'time_ns', lambda: now)
    reader, found = TopicReader(ros.node, String, '/words', 1), []
    monkeypatch.setattr(reader, '_taker', SimpleNamespace(
        has_reception_times=False, take=lambda most: [(b'', '', 0, sent)]))
    for now, sent in (50, 40), (100, 61), (150, 149), (200, 120):  # noqa: B007
        found += [message.time for message in reader.take()]
    assert found == [50, 71, 150, 150]
    reader.close()


def test_large_headers_pause(ros, monkeypatch):
    """After too many bytes, a topic is left; in the next second, it is read again."""
    monkeypatch.setattr(header_sampler, '_MOST_BYTES', 10)
    publisher = ros.node.create_publisher(PointStamped, '/points', 1)
    sampler = HeaderSampler(ros.node)

    def has_readers(number):
        sampler.poll()
        return publisher.get_subscription_count() == number

    for number in 1, 2:
        ros.until(lambda: has_readers(1))
        publisher.publish(point('base'))
        ros.until(lambda: has_readers(0))
        assert sampler.headers['/points'].count == number
    sampler.close()
