"""The queue of a MessageFilter: what waits, what is ready, what is dropped, and in which order."""

from collections import Counter
import random
import threading
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from messages import ArrivedMessages
import pytest
from recorded import judged, MS, T, tf

from puretf import TransformBuffer, TransformException
from puretf._core.engine import engine_of
from puretf._core.filter_queue import FilterFailureReason, FilterQueue
from puretf._core.pose import IDENTITY, Row
from puretf._wire import cdr
from puretf_tools.doctor.message_times import Verdict

CACHE = 100
UNKNOWN, OLD, EMPTY, TIMEOUT, FULL = FilterFailureReason


class Setup:
    """A queue whose messages are their own numbers; all times in ns."""

    def __init__(self, targets=('map',), tolerance=0, size=0, cache=CACHE):
        """Create the queue, and the buffer that it looks up in."""
        self.now = self.number = 0
        self.buffer = TransformBuffer(cache)
        self.queue = FilterQueue(self.buffer, targets, tolerance, size, lambda: self.now)

    def put(self, *stamps, frame='laser'):
        """Put messages as the filter does."""
        for stamp in stamps:
            self.queue.put(stamp, frame, self.number)
            self.queue.shorten()
            self.number += 1

    def insert(self, *stamps, child='laser', parent='map'):
        """Insert transforms, and look up the messages that wait."""
        for stamp in stamps:
            self.buffer.insert(stamp, parent, child, IDENTITY)
        self.queue.ready()

    def outcomes(self):
        """Take what is due: the stamp, or the stamp and the reason, of each message."""
        return [entry.stamp if entry.reason is None else (entry.stamp, entry.reason)
                for entry in iter(self.queue.take, None)]


@pytest.fixture
def setup():
    """A queue without a limit."""
    return Setup()


def test_a_message_whose_lookup_inserts_transforms(setup):
    """If they are those of older messages, these are taken first."""
    setup.insert(1)
    setup.put(3, 2)
    engine_of(setup.buffer).add_source(ArrivedMessages(cdr.pack(
        [Row(stamp, 'map', 'laser', IDENTITY) for stamp in (2, 5)])))
    setup.put(4)
    assert setup.outcomes() == [2, 3, 4]


def test_a_stamp_of_zero_is_never_too_old(setup):
    """It waits until there is a time for which all edges have data."""
    setup.insert(1000, 1010, child='odom')
    setup.insert(500, parent='odom')
    setup.put(0)
    assert setup.outcomes() == []
    setup.insert(1010, parent='odom')
    assert setup.outcomes() == [0]


def test_a_timeout(setup):
    """Each message has its own; the rest of the next one is returned, 0 if no message waits."""
    setup.put(9)
    setup.now = 4
    setup.put(8)
    assert setup.queue.expire(10) == 6
    assert setup.outcomes() == []
    setup.now = 10
    assert setup.queue.expire(10) == 4
    assert setup.outcomes() == [(9, TIMEOUT)]
    assert setup.queue.expire(0) == 0
    assert setup.outcomes() == [(8, TIMEOUT)]
    assert setup.queue.dropped[TIMEOUT] == 2


def test_a_transform_that_is_lost(setup):
    """The reason is Unknown if it is lost before the message is taken."""
    setup.put(1)
    setup.insert(1)
    setup.buffer.clear()
    assert setup.outcomes() == [(1, UNKNOWN)]
    assert setup.queue.dropped[UNKNOWN] == 1


def test_several_threads():
    """Every message is ready exactly once, whatever the order of messages and transforms."""
    setup, number, outcomes = Setup(cache=10**9), 400, []  # keeps 10 000 samples

    def put(offset):
        for stamp in range(offset, number + 1, 4):
            setup.queue.put(stamp, 'laser', None)

    threads = [*(threading.Thread(target=put, args=(offset + 1,)) for offset in range(4)),
               threading.Thread(target=lambda: [setup.insert(i) for i in range(number + 1)])]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        outcomes += setup.outcomes()
    outcomes += setup.outcomes()
    assert sorted(outcomes) == [*range(1, number + 1)]


class Specification:
    """What the queue does, but each message is looked up by itself, after each event."""

    def __init__(self, setup):
        """Create the specification of a queue."""
        self.buffer, self.queue = setup.buffer, setup.queue
        self.waiting: list[tuple[int, int, str]] = []

    def _is_too_old(self, target, frame, time):
        try:
            latest = self.buffer.get_latest_common_time(target, frame)
        except TransformException:
            return False
        return bool(latest) and 0 != time < latest - CACHE and not self.buffer.can_transform(
            target, frame, time)

    def outcomes(self, *new):
        """Return what is due after the arrival of a message, or after an insertion."""
        self.waiting += new
        reasons: dict[tuple[int, int, str], Any] = {}
        for message in self.waiting:
            stamp, _, frame = message
            lookups = [(target, frame, time) for target in self.queue.targets
                       for time in {stamp, stamp + self.queue.tolerance}]
            if not frame:
                reasons[message] = EMPTY
            elif all(self.buffer.can_transform(*lookup) for lookup in lookups):
                reasons[message] = None
            elif any(self._is_too_old(*lookup) for lookup in lookups):
                reasons[message] = OLD
        waiting = [message for message in self.waiting if message not in reasons]
        surplus = len(waiting) - (self.queue.size or len(waiting))
        reasons.update((message, FULL) for message in waiting[:max(0, surplus)])
        self.waiting = [message for message in waiting if message not in reasons]
        return [(*message[:2], reason) for message, reason in sorted(reasons.items())]


#: A message (frame, age), or a transform (parent, child, age) every 10 ns; its age in ns.
EVENTS = st.lists(st.one_of(
    st.tuples(st.sampled_from([*['laser', 'camera'] * 5, 'lost', '']), st.integers(-4, CACHE + 9)),
    *[st.tuples(st.just(parent), st.just(child), st.integers(0, 20)) for parent, child in (
        ('map', 'odom'), ('odom', 'base'), ('base', 'laser'), ('base', 'camera'),
        ('odom', 'laser'), ('other', 'lost'), ('map', 'other'))]), min_size=20, max_size=60)


def test_random_events_against_the_specification():
    """After each event, the same messages are due, in order; edges get other parents."""
    reasons: set[FilterFailureReason] = set()

    @given(st.sampled_from([(('map',), 0, 0), (('map', 'odom'), 3, 9), (('base', 'other'), 0, 3)]),
           EVENTS)
    def check(arguments, events):
        setup = Setup(*arguments)
        specification, dropped = Specification(setup), Counter[FilterFailureReason]()
        for i, (*names, age) in enumerate(events):
            stamp, new = 10 * i + 1000 - age, []
            if len(names) == 1:
                new.append((stamp, setup.number, names[0]))
                setup.put(stamp, frame='/' * (i % 2) + names[0])
            else:
                setup.insert(stamp, parent=names[0], child=names[1])
            expected = specification.outcomes(*new)
            assert [(entry.stamp, entry.message, entry.reason)
                    for entry in iter(setup.queue.take, None)] == expected
            dropped.update(reason for *_, reason in expected if reason is not None)
        assert dropped == Counter(setup.queue.dropped)
        reasons.update(dropped)

    check()
    assert reasons == {EMPTY, FULL, OLD}


@pytest.mark.parametrize('seed', range(8))
def test_tf_doctor_predicts_what_is_passed_on(seed):
    """With the size of its table, a queue passes on what it says; with half of it, less."""
    choose = random.Random(seed)
    steps = [(edge, choose.choice([0, 20, 200, 700]), choose.choice([100, 250, 1000]))
             for edge in ('map odom', 'odom base')]
    transforms = [tf(i + delay, i, edge) for edge, delay, step in steps
                  for i in range(0, choose.choice([12_000, 15_000]), step)]
    messages = [(i, i - choose.choice([0, 0, 30, 300, 300, 11_000, -400]))
                for i in range(710, 15_000, 200)]
    times = judged(transforms, messages)
    size = times.queue()
    assert size > 1
    passed = [stamp for stamp, verdict in zip(times.stamps.tolist(), times.verdicts.tolist())
              if verdict in (Verdict.AT_ONCE, Verdict.WAITS)]
    assert len(passed) == times.count(Verdict.AT_ONCE, Verdict.WAITS) < len(messages)
    assert sorted(passed_on(transforms, messages, size)) == sorted(passed)
    assert len(passed_on(transforms, messages, size // 2)) < len(passed)


def passed_on(transforms, messages, size):
    """Return the stamps of the messages that a queue passes on; they arrive in turn."""
    setup, outcomes = Setup(size=size, cache=10_000 * MS), []
    for _, is_message, event in sorted([*((each.time, 0, each) for each in transforms), *(
            (T + arrival * MS, 1, T + stamp * MS) for arrival, stamp in messages)],
            key=lambda event: event[:2]):
        if is_message:
            setup.put(event, frame='base')
        else:
            for row in event.rows():
                setup.insert(row.stamp_ns, child=row.child_frame_id, parent=row.frame_id)
        outcomes += setup.outcomes()
    return [outcome for outcome in outcomes if isinstance(outcome, int)]
