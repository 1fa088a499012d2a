"""What `tf_doctor` observes beside transforms: who feeds them."""

from collections.abc import Callable, Collection, Mapping, Sequence

#: The largest number of publishers of a topic, and of joints of one of them.
_MOST_PUBLISHERS, _MOST_NAMES = 1000, 10_000


class Sender:
    """The messages of one publisher on a topic."""

    def __init__(self, node: str = '') -> None:
        self.node = node  #: the full name of its node
        self.names: set[str] = set()  #: of joint states: the joints that it sends
        self.count = 0
        self.first = self.last = 0  #: the times of arrival of the first and the last message (ns)
        self.stamp = 0  #: the last stamp (ns)

    def add(self, arrival: int, stamp: int, names: Collection[str] = ()) -> None:
        self.first, self.last, self.stamp = self.first or arrival, arrival, stamp
        self.count += 1
        if len(self.names) < _MOST_NAMES:
            self.names.update(names)


class Senders(dict[str, Sender]):
    """The publishers of a topic, by their gids."""

    def add(self, gid: str, arrival: int, stamp: int, names: Collection[str] = ()) -> None:
        """Count a message, unless there are too many publishers."""
        if gid in self or len(self) < _MOST_PUBLISHERS:
            self.setdefault(gid, Sender()).add(arrival, stamp, names)

    def named(self, names_of: Callable[[Collection[str]], Mapping[str, str]]) -> list[Sender]:
        """Return the senders; `names_of` returns by gid the full names of their nodes."""
        for gid, name in names_of(self).items():
            self[gid].node = name
        return [*self.values()]


def rivals(senders: Sequence[Sender]) -> list[Sender]:
    """Return the senders that send at the same time as another one, not after it."""
    return [a for a in senders if any(
        a is not b and max(a.first, b.first) <= min(a.last, b.last) for b in senders)]
