"""What arrives again and again, as the transforms of a frame: its arrivals and stamps, judged."""

from functools import cached_property
from math import nan
from typing import NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray

from puretf import SECOND
from puretf._causes.facts import OTHER_CLOCK
from puretf.transform_buffer import CACHE_TIME

#: What arrives more than `LATE` (ns) after its stamp is late; if its stamp is more than `FUTURE`
#: (ns) after its arrival, it is from the future.
LATE, FUTURE = SECOND // 2, SECOND // 10
#: What is said of at least this part of the messages is reported.
SHARE = 0.05
#: A step from stamp to stamp is a gap if it is longer than this many periods. Shorter gaps than
#: `SHORTEST_GAP` (ns) are jitter, which a busy computer causes. They are reported if they are at
#: least the part `_JITTER` of all steps, and at least `_FEWEST_GAPS`.
GAP, SHORTEST_GAP, _JITTER, _FEWEST_GAPS = 3, SECOND // 2, 0.02, 3
#: The smallest number of steps, and of delays, that are judged. A shorter period (ns) counts as
#: this one, since some programs send several transforms of a frame at once.
FEWEST, _FEWEST_DELAYS, _SHORTEST_PERIOD = 10, 3, SECOND // 1000
#: A stamp that several messages have has stalled after this time (ns), and so many periods.
_STALLED, _PERIODS = SECOND, 3
#: Stamps that alternate between two clocks go back by more than this (ns), more often than this,
#: and for more than this part of the messages.
_TURN, _FEW_TURNS, _TURNS = 5 * SECOND, 3, 0.05
#: Messages come in groups if more than this part of the steps is longer than `GAP` periods.
_GROUPS = 0.3
#: If the nanoseconds of stamps are all below the first number, while delays differ by more than
#: the second one (ns), at this rate (Hz) or more, they are another unit.
_FIRST_PART, _SPREAD, _LEAST_RATE = SECOND // 5, SECOND // 2, 5.0
_Array = NDArray[np.int64]
NEVER = np.iinfo(np.int64).max


class Step(NamedTuple):
    """A step forward from stamp to stamp."""

    length: int = 0  #: ns
    begin: int = 0  #: the stamp before it (ns)
    at: int = 0  #: the index of that


class Availability:
    """Transforms as a listener receives them."""

    def __init__(self, arrivals: _Array, stamps: _Array) -> None:
        """Take transforms (at least one), given by their arrivals and their stamps (ns)."""
        # When a bag or a simulation starts again, listeners clear their data.
        goes_back = np.maximum(stamps[1:-1], stamps[2:]) < stamps[:-2] - CACHE_TIME
        start = int(np.flatnonzero(goes_back)[-1]) + 1 if goes_back.any() else 0
        self.arrivals, stamps = arrivals[start:], stamps[start:]
        self._newest = np.maximum.accumulate(stamps)  # (n,) at each arrival
        self._stamps = np.sort(stamps)
        self.begin, self.end = int(stamps[0]), int(self._newest[-1])  #: first, newest stamp (ns)

    def reaches(self, stamps: _Array) -> _Array:
        """Return when a transform with these stamps or newer ones arrives; `NEVER`: never."""
        return np.append(self.arrivals, NEVER)[self._newest.searchsorted(stamps)]

    def needed_cache(self, stamps: _Array, times: _Array) -> _Array:
        """Return how long transforms must be kept (ns) if stamps are looked up at some times."""
        # A transform that arrives does not count yet when the old ones are dropped.
        last = np.maximum(self.arrivals.searchsorted(times, 'right') - 2, 0)
        before = np.maximum(self._stamps.searchsorted(stamps, 'right') - 1, 0)
        return self._newest[last] - self._stamps[before]


class Stream:
    """
    The arrivals and the stamps of the transforms of a frame, or of the messages of a topic.

    Of what is computed, only numbers are kept, and the `edge` if messages need it, since there can
    be millions of them.
    """

    def __init__(self, arrivals: _Array, stamps: _Array, times: Optional[_Array] = None,
                 begin: int = 1) -> None:
        """
        Take (n,) messages; those with a stamp of 0 only count as such.

        :param arrivals: on the system clock (ns); 0: not known.
        :param stamps: ns
        :param times: the arrivals on the clock of the stamps (ns); None: not known.
        :param begin: what arrives before has no delay.
        """
        self.zero_stamps = int(np.count_nonzero(stamps == 0))
        if self.zero_stamps or (arrivals[1:] < arrivals[:-1]).any():
            order = np.argsort(arrivals, kind='stable')
            order = order[stamps[order] != 0]
            times = None if times is None else times[order]
            arrivals, stamps = arrivals[order], stamps[order]
        self.arrivals, self.stamps, self._times = arrivals, stamps, times
        #: The range of the stamps (ns); 0, 0: there is none.
        self.oldest, self.latest = (int(stamps.min()), int(stamps.max())) if len(stamps) else (
            0, 0)
        self._judge_steps(np.diff(stamps))
        self._judge_stalls()
        delays = self._delays()
        self._judge_delays(np.empty(0, np.int64) if delays is None else
                           delays[arrivals >= max(begin, 1)])

    def _judge_steps(self, steps: _Array) -> None:
        forward = steps[steps > 0]
        self.steps = len(forward)  #: the number of steps forward, from stamp to stamp
        self.period = float(np.median(forward)) if self.steps else 0.0  #: their median (ns)
        #: The indices of the stamps before gaps.
        self.gaps = np.flatnonzero(steps > GAP * max(self.period, _SHORTEST_PERIOD))
        if len(self.gaps) > _GROUPS * self.steps:  # as of two publishers: between groups of them
            self.gaps = np.flatnonzero(steps > GAP * np.median(steps[self.gaps]))
        if (steps < 0).any():  # after a step back, other stamps can fill a step
            ordered = np.sort(self.stamps)
            is_filled = ordered.searchsorted(self.stamps[self.gaps], 'right') < (
                ordered.searchsorted(self.stamps[self.gaps + 1]))
            steps[self.gaps[is_filled]] = 0
            self.gaps = self.gaps[~is_filled]
        #: The largest one; of length 0: there is none.
        self.largest_step = self.longest(np.array([steps.argmax()])) if self.steps else Step()
        self.backwards = int(np.count_nonzero(steps < 0))  #: the number of steps back
        self.step_back = -int(steps.min(initial=0))  #: the largest step back (ns)
        #: The stamp before it (ns); 0: there is none.
        self.step_back_at = int(self.stamps[steps.argmin()]) if self.step_back else 0
        #: True if the stamps are of two clocks in turn, as those of two publishers.
        self.alternates = int(np.count_nonzero(steps < -_TURN)) > max(
            _FEW_TURNS, _TURNS * len(self.stamps))

    def _judge_stalls(self) -> None:
        self.stalled = 0  #: how many messages have a stamp that stands, though messages arrive
        #: That which stands longest (ns), and for how long (ns); whether the last stamp stands.
        self.stall_stamp, self.stall_span, self.stands = 0, 0, False
        if len(self.stamps) - self.steps < 3 or self._times is None:
            return
        changes = np.flatnonzero(np.diff(self.stamps)) + 1
        begins, ends = np.append(0, changes), np.append(changes, len(self.stamps))
        spans, numbers = self._times[ends - 1] - self._times[begins], ends - begins
        has_stalled = (numbers > 2) & (spans >= max(_STALLED, _PERIODS * self.period))
        if has_stalled.any():
            i = int(np.where(has_stalled, spans, 0).argmax())
            self.stalled, self.stands = int(numbers[has_stalled].sum()), bool(has_stalled[-1])
            self.stall_stamp, self.stall_span = int(self.stamps[begins[i]]), int(spans[i])

    def _judge_delays(self, delays: _Array) -> None:
        self.delays = len(delays)  #: how many are known
        #: Their mean (ns); NaN if there is none, or they are from two clocks.
        self.mean_delay = float(delays.mean()) if self.delays and not self.alternates else nan
        self.least_delay, self.greatest_delay = (int(delays.min()), int(delays.max())) if (
            self.delays) else (0, 0)
        #: How many are so large that the stamp is from another clock, late, or from the future.
        self.foreign = int(np.count_nonzero(np.abs(delays) > OTHER_CLOCK))
        self.late = int(np.count_nonzero((delays > LATE) & (delays <= OTHER_CLOCK)))
        self.future = int(np.count_nonzero((delays < -FUTURE) & (delays >= -OTHER_CLOCK)))
        low, median, high = np.quantile(delays, (0.1, 0.5, 0.9)).tolist() if (
            self.delays >= _FEWEST_DELAYS) else (0, 0, SECOND)
        #: The stamps minus the arrivals (ns), if they vary little; None: they do not.
        self.offset = -round(median) if high - low < SECOND else None

    def _delays(self) -> Optional[_Array]:
        """Return the (n,) times from the stamps to the arrivals (ns); None: not known."""
        return None if self._times is None else self._times - self.stamps

    def has_many(self, field: str, excused: float = 0.0) -> bool:
        """Return whether more messages, whose stamps do not stand, are 'late', and so on."""
        return bool(getattr(self, field) - self.stalled - excused > SHARE * self.delays)

    def late_spans(self) -> tuple[_Array, _Array]:
        """Return when those that are late were sent, and when they have arrived (ns)."""
        delays = np.asarray(self._delays())
        arrivals, late = (each[(delays > LATE) & (delays <= OTHER_CLOCK)] for each in (
            self.arrivals, delays))
        return arrivals - late, arrivals

    @property
    def is_in_time(self) -> bool:
        return -FUTURE <= self.mean_delay <= LATE and not any(
            map(self.has_many, ('late', 'future', 'foreign')))

    @cached_property
    def edge(self) -> Availability:
        """The same as a listener receives it; there must be at least one."""
        return Availability(self.arrivals, self.stamps)

    def is_hole(self, at: int) -> bool:
        """Return True if nothing has arrived during a step, given by the index before it."""
        pauses = np.diff(self.arrivals)
        return bool(pauses[at] > GAP * np.median(pauses))

    def longest(self, at: _Array) -> Step:
        """Return the longest of some steps, given by the indices before them."""
        steps = self.stamps[at + 1] - self.stamps[at]
        i = steps.argmax()
        return Step(int(steps[i]), int(self.stamps[at[i]]), int(at[i]))

    def has_gaps(self, gaps: _Array) -> bool:
        """Return whether some of its gaps are many, or one of them is long."""
        if self.steps < FEWEST or not len(gaps):
            return False
        step = self.longest(gaps)
        return len(gaps) >= max(_FEWEST_GAPS, _JITTER * self.steps) or bool(
            step.length > SHORTEST_GAP and (not self.stalled or self.is_hole(step.at)))

    @cached_property
    def clock_step(self) -> Optional[tuple[float, float]]:
        """The delays (ns) before and after a step forward of the stamps' clock; None: no step."""
        delays = self._delays()
        length, _, at = self.largest_step
        if length <= max(SHORTEST_GAP, GAP * self.period) or delays is None or self.is_hole(at):
            return None
        parts = delays[:at + 1], delays[at + 1:]
        if min(map(len, parts)) < FEWEST:
            return None
        (low, before, high), (least, after, most) = (
            np.quantile(part, (0.1, 0.5, 0.9)).tolist() for part in parts)
        return (before, after) if max(high - low, most - least) < LATE < before - after else None

    @property
    def is_frozen(self) -> bool:
        """True if all have the same stamp."""
        return self.stalled > 0 and self.oldest == self.latest and not self.zero_stamps

    @property
    def odd_nanoseconds(self) -> str:
        """What is odd with the nanoseconds of stamps, if they are another unit; else ''."""
        if len(self.stamps) < FEWEST:
            return ''
        span, largest = np.ptp(self.stamps), int((self.stamps % SECOND).max())
        if largest > _FIRST_PART or np.ptp(self.arrivals - self.stamps) < _SPREAD or (
                span < 2 * SECOND or len(self.stamps) * SECOND < _LEAST_RATE * span):
            return ''
        if not largest:
            return 'nanosec is always 0 (whole seconds)'
        unit = ('milliseconds' if largest < 1000 else 'microseconds' if largest < 1_000_000 else
                '')
        return f'nanosec is never above {largest}{f", as {unit} are," if unit else ""}'
