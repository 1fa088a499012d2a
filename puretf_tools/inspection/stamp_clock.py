"""The clock by which arrivals are compared with stamps: /clock, or that of the computer."""

from array import array
from collections.abc import Callable, Sequence
from threading import Lock
from time import time_ns
from typing import Optional

import numpy as np
from numpy.typing import NDArray

from puretf import SECOND
from puretf._causes.facts import OTHER_CLOCK

#: For how long, at most, messages wait for the choice of the clock (s).
PATIENCE = 5.0
#: The largest number of times of /clock that are kept, and from how many its pace is computed.
_MOST, _PACE = 20_000, 10


class StampClock:
    """
    The clock of the stamps; that of the computer, unless `is_simulated` is set.

    Between two messages of /clock, its time is interpolated, since /clock can be slow. Any thread
    may ask: a warning of the listener is written in that of its node.
    """

    def __init__(self, system: Callable[[], int] = time_ns) -> None:
        self.system = system  #: returns the time of the system clock (ns)
        self.is_simulated = False  #: whether it is /clock
        #: When messages of /clock arrived (ns, on the system clock), and their times (ns).
        self._arrivals, self._times, self._lock = array('q'), array('q'), Lock()

    def add(self, arrival: int, time: int) -> None:
        with self._lock:
            if len(self._times) > _MOST:
                del self._arrivals[:_MOST // 2], self._times[:_MOST // 2]
            if self._times and not 0 <= time - self._times[-1] < OTHER_CLOCK:
                # A jump: until this message, time has stood.
                self._arrivals.append(arrival - 1)
                self._times.append(self._times[-1])
            self._arrivals.append(arrival)
            self._times.append(time)

    def at(self, arrivals: NDArray[np.int64]) -> Optional[NDArray[np.int64]]:
        """Convert (n,) times of the system clock to this clock (ns); None: it is not known."""
        return self._simulated(arrivals) if self.is_simulated else arrivals

    def now(self) -> int:
        """Return the present time (ns); 0: not known, as nothing has arrived on /clock."""
        now = self.at(np.array([self.system()]))
        return 0 if now is None else int(now[0])

    def choice(self, stamps: Sequence[int]) -> Optional[bool]:
        """
        Return whether most stamps fit /clock, and not the system clock; None: it is not known.

        :param stamps: the newest stamp of each frame (ns).
        """
        values, system = np.array(stamps, np.int64), np.array([self.system()])
        to_system, now = np.abs(system - values), self._simulated(system)
        to_clock = to_system if now is None else np.abs(now - values)
        fits_clock = (to_clock <= OTHER_CLOCK) & (to_clock + SECOND < to_system)
        fits_system = (to_system <= OTHER_CLOCK) & ~fits_clock
        if not (fits_clock | fits_system).any():
            return None
        return bool(fits_clock.sum() > fits_system.sum())

    def _simulated(self, arrivals: NDArray[np.int64]) -> Optional[NDArray[np.int64]]:
        with self._lock:
            known, times = np.array(self._arrivals), np.array(self._times)
        if not len(times):
            return None
        steps = np.sort(np.diff(np.array([known[-_PACE:], times[-_PACE:]])))
        # The median leaves out jumps.
        period, step = steps[:, steps.shape[1] // 2] if len(times) > 1 else (SECOND, SECOND)
        pace = step / period if period else 1.0
        after = (arrivals - known[-1]).clip(0, 2 * period)
        before = (known[0] - arrivals).clip(0)
        # Differences, since floats have no room for dates in nanoseconds.
        return np.asarray(times[0] + np.rint(
            np.interp(arrivals - known[0], known - known[0], times - times[0])
            + pace * (after - before)).astype(np.int64))
