"""The transforms of an arm, by frame, as the requirements and their causes look at them."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import groupby
from math import asin, pi
from typing import Any, Optional

import numpy as np

from dummy_arm.grading.records import ArmMessage, ArmPublisher
from dummy_arm.grading.sheet import FRAMES, SHEET
from dummy_arm.grading.sine import Floats
from puretf import SECOND
from puretf._text.names import shortened
from puretf_tools.inspection.traffic import recreated

#: The mean of |w| is larger, unless another number is in its place: joints turn by ±60° at most.
_SMALL_W = 0.4


class Samples:
    """The transforms of one frame, each with its message, in the order of their arrival."""

    def __init__(self, rows: list[tuple[ArmMessage, Any]]) -> None:
        # As they appear.
        self.parents = [*{row.frame_id.removeprefix('/'): None for _, row in rows}]
        self.is_static = np.array([message.is_static for message, _ in rows])
        self.poses = np.array([row.pose for _, row in rows], float)
        self.positions = self.poses[:, :3]  # (m)
        self.publishers = [message.publisher for message, _ in rows]
        moving = [(message, row) for message, row in rows if not message.is_static]
        #: Of the transforms on /tf: the times of arrival (s; 0: not known) and the stamps (ns).
        self.times = np.array([message.time / SECOND for message, _ in moving])
        self.stamps = np.array([row.stamp_ns for _, row in moving], np.int64)
        #: The times from the stamps to the arrivals (s) of the transforms on /tf.
        self.delays = self.times - self.stamps / SECOND

    @property
    def interval(self) -> float:
        """The median time from one transform on /tf to the next one (s)."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else 0.0

    @property
    def ticks(self) -> Floats:
        """The numbers of the stamps on /tf, times the median interval of the stamps (s)."""
        steps = np.diff(self.stamps)
        is_new = steps != 0
        interval = np.median(abs(steps[is_new])) / SECOND
        return np.asarray(np.append(0, np.cumsum(is_new)) * interval)

    @cached_property
    def rotations(self) -> Floats:
        """(n, 4): the unit quaternions x, y, z, w."""
        quaternions = self.poses[:, 3:]
        return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1)[:, None])

    @cached_property
    def angles(self) -> Floats:
        """(n,): the angles about z (rad), from -pi to pi."""
        angles = 2 * np.arctan2(self.poses[:, 5], self.poses[:, 6])
        return np.asarray((angles + pi) % (2 * pi) - pi)

    @property
    def largest_angle(self) -> float:
        return float(abs(self.angles).max())

    @property
    def has_wrong_order(self) -> bool:
        """Whether another number is probably in the place of w."""
        return float(abs(self.rotations[:, 3]).mean()) < _SMALL_W

    @property
    def is_published_twice(self) -> bool:
        """Whether two publishers send the frame at the same time."""
        # If each begins after the one before it has ended, as when a program is started again,
        # the messages of each are one group.
        return len([*groupby(self.publishers)]) > len(set(self.publishers))


class Arm:
    """The transforms of an arm, and who sends them."""

    def __init__(self, messages: Iterable[ArmMessage], reaches_late_joiners: Optional[bool] = None,
                 end: Optional[int] = None, publishers: Sequence[ArmPublisher] = (),
                 int_line: int = 0, place: str = '', no_clock: str = '') -> None:
        """
        Sort messages by frame.

        :param messages: the messages of /tf and /tf_static, in the order of their times.
        :param reaches_late_joiners: whether a listener that started later than the arm has
            received base_link; None: not known, which does not count as a failure.
        :param end: the end of the observation (ns); None: the time of the last message on /tf.
        :param publishers: the publishers on /tf and /tf_static, also those that are gone; those of
            the oldest process first; empty: not known.
        :param int_line: a line of the program in which a number is an int; 0: none is known.
        :param place: the line in which the program is, if it sends nothing; '': not known.
        :param no_clock: that a node of the arm waits for /clock in vain; '': none does.
        """
        self.reaches_late_joiners, self.publishers = reaches_late_joiners, publishers
        self.int_line, self.place, self.no_clock = int_line, place, no_clock
        #: By publisher: the name and the process id of its node.
        self.nodes = {each.gid: (each.node, each.pid) for each in publishers}
        rows: defaultdict[str, list[tuple[ArmMessage, Any]]] = defaultdict(list)
        #: A frame that is in one message more than once; '': none.
        self.repeated = ''
        for message in messages:
            for row in message.rows:
                name = row.child_frame_id.removeprefix('/')
                if rows[name] and rows[name][-1][0] is message:
                    self.repeated = name
                rows[name].append((message, row))
        self.samples = {name: Samples(found) for name, found in rows.items()}
        self.others = [shortened(name) for name in self.samples if name not in FRAMES]
        #: The frames of the arm that belong on /tf and are there, in the order of the chain.
        self.moving = {edge.name: samples for edge in SHEET[1:]
                       if (samples := self.samples.get(edge.name)) and len(samples.times)}
        times = [samples.times[-1] for samples in self.samples.values() if len(samples.times)]
        self.end = max(times, default=0.0) if end is None else end / SECOND  # s

    @cached_property
    def senders(self) -> dict[Any, dict[str, set[str]]]:
        """By topic and node: its publishers, each with the frames that it has sent."""
        found: defaultdict[Any, defaultdict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
        for each in self.publishers:  # also those that have sent nothing
            found[each.is_static, self.nodes[each.gid]][each.gid] = set()
        for name, samples in self.samples.items():
            for is_static, gid in {*zip(samples.is_static.tolist(), samples.publishers)}:
                found[is_static, self.nodes.get(gid)][gid].add(name)
        return {**found}

    @cached_property
    def recreated(self) -> int:
        """How many publishers one program creates one after another; 0: none is known."""
        return max((len(recreated(publishers)) for publishers in self.senders.values()), default=0)


def largest_angle(vectors: Floats) -> float:
    """Return the largest angle (rad), from vector parts of quaternions: axis * sin(angle / 2)."""
    return 2 * asin(min(1.0, float(np.linalg.norm(vectors, axis=1).max())))
