"""
A listener that knows which node has published a transform.

Each publisher has a *gid*, by which the middleware identifies the publisher. A gid arrives with
each message, and the ROS graph tells to which node the publisher with this gid belongs.
"""

from collections import deque
from collections.abc import Iterable
from itertools import groupby
from operator import attrgetter
from typing import Any, NamedTuple, Optional

from puretf._causes.explanation import explain_silence, why_not_received
from puretf._causes.facts import Surroundings, UNKNOWN
from puretf._core.frames import Frame
from puretf._core.pose import BatchOrRows
from puretf._ros.graph import gid_of, node_of, nodes_on
from puretf._ros.other_topics import TransformSampler
from puretf._ros.rclpy_private import is_given, Taker
from puretf._ros.subscription import SubscriptionSource, TopicSubscription
from puretf._ros.topic_watch import Publishers, TopicReader, TopicWatch
from puretf._text.names import TF_MESSAGE
from puretf._wire.received_message import ReceivedMessage
from puretf.transform_listener import TransformListener

__all__ = ['UNKNOWN', 'PublisherListener', 'Received', 'ReceivedMessage', 'TopicReader',
           'TopicWatch', 'TransformSampler', 'gid_of', 'is_given', 'node_of', 'nodes_on']

#: The largest number of messages that are kept for `received`, and of their bytes.
_MOST_MESSAGES, _MOST_BYTES = 10_000, 2**24


class Received(NamedTuple):
    """The messages that have arrived since the last call of `PublisherListener.received`."""

    messages: list[ReceivedMessage]  #: the messages of each topic are in the order of arrival
    dropped: int  #: the number of older messages that were dropped, to limit the memory


class _Kept:
    """The newest messages, up to a number and a size."""

    def __init__(self) -> None:
        self._messages: deque[ReceivedMessage] = deque()
        self._size = self._dropped = 0

    def add(self, messages: list[ReceivedMessage]) -> None:
        self._messages += messages
        self._size += sum(map(len, messages))
        while len(self._messages) > _MOST_MESSAGES or self._size > _MOST_BYTES:
            self._size -= len(self._messages.popleft())
            self._dropped += 1

    def take(self) -> Received:
        messages, dropped = self._messages, self._dropped
        self._messages, self._size, self._dropped = deque(), 0, 0
        return Received([*messages], dropped)


class _GidSource(SubscriptionSource):
    """A source with the gid of the publisher as authority."""

    def __init__(self, *args: Any, publishers: Publishers, kept: _Kept) -> None:
        super().__init__(*args)
        self._publishers, self._kept = publishers, kept
        self._takers = {each: Taker(each.subscription) for each in self._subscriptions}

    def _take(self, subscription: TopicSubscription) -> list[ReceivedMessage]:
        taken = self._takers[subscription].take(subscription.max_messages)
        return [ReceivedMessage.of(*each) for each in taken]

    def _read(self, subscription: TopicSubscription, messages: list[Any]) -> list[BatchOrRows]:
        for message in messages:
            message.is_static = subscription.is_static
        self._kept.add(messages)
        batches: list[BatchOrRows] = []
        for gid, group in groupby(messages, attrgetter('publisher')):
            batches += subscription.reader.read(group, gid, subscription.is_static)
        return batches

    def next_pause(self) -> float:
        self._publishers.query_if_due()
        pause = super().next_pause()
        # A pause would count as delay of the messages.
        return pause if all(each.has_reception_times for each in self._takers.values()) else 0.0


class PublisherListener(TransformListener):
    """
    A TransformListener that knows which node has published the newest transform of a frame.

    With some middleware, the number that arrives with a message is not the gid of any publisher in
    the ROS graph. Then the node is not known.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """
        Subscribe and start the thread, as TransformListener does.

        :raises TypeError: if the listener would use subscriptions of the node; see
            `TransformListener`.
        """
        super().__init__(*args, **kwargs)
        if self._uses_callbacks:
            self.unregister()
            raise TypeError('a PublisherListener needs a buffer of puretf and no overridden '
                            f'callbacks or setters, got {self.buffer!r}')

    def _create_source(self, *args: Any) -> SubscriptionSource:
        self._kept = _Kept()
        self._publishers = Publishers(
            self.node, {each.topic_name for each in self.subscriptions}, TF_MESSAGE)
        return _GidSource(*args, publishers=self._publishers, kept=self._kept)

    @property
    def present(self) -> frozenset[str]:
        """The gids (in hex) of the publishers that exist; updated every half second."""
        return self._publishers.present

    def publishers(self) -> dict[str, tuple[str, str]]:
        """
        Return the publishers that were found in the ROS graph, also those that are gone.

        :returns: by gid (in hex): the full name of the node, and the topic. The ROS graph is
            queried every half second.
        """
        return dict(self._publishers.nodes)

    def is_present(self, gid: str) -> Optional[bool]:
        """
        Return whether a publisher exists.

        :returns: True if it exists; False if it existed and has ended; None if the gid (in hex)
            was never that of a publisher in the ROS graph.
        """
        return gid in self.present or (False if gid in self._publishers.nodes else None)

    def received(self) -> Received:
        """
        Return the messages that have arrived since the last call of this method.

        Between two calls, only the newest messages are kept: at most 10 000, and at most 16 MiB.
        """
        with self.buffer.updated():
            return self._kept.take()

    def frames(self) -> list[Frame]:
        """
        Return the frames of the buffer, each with the name of the node that has published it.

        :returns: the frames that have a parent, as `buffer.frames()` returns them, but with the
            name from `names_of` as the `authority`.
        """
        frames: list[Frame] = self.buffer.frames()
        names = self.names_of(frame.authority for frame in frames)
        return [frame._replace(authority=names[frame.authority]) for frame in frames]

    def names_of(self, gids: Iterable[str]) -> dict[str, str]:
        """
        Return the full names of the publishers' nodes.

        :param gids: the gids of the publishers, in hex.
        :returns: a dict from each gid to the name of the node, or to `UNKNOWN`.
        """
        return self._publishers.names_of(gids)

    def wrong_type_hint(self) -> str:
        """Return who publishes another type than TFMessage on the topics; '' if nobody does."""
        return why_not_received(self._surroundings(), ['wrong_type'])

    def topics_hint(self) -> str:
        """Return why transforms may not arrive; '' if there is no sign of it."""
        return why_not_received(self._surroundings())

    def why_nothing(self) -> str:
        """Return why nothing at all was received; '' if something was."""
        return explain_silence(self._surroundings())

    def _surroundings(self) -> Surroundings:
        return super()._surroundings()._replace(ended={
            gid: node for gid, (node, _) in tuple(self._publishers.nodes.items())
            if gid not in self.present})
