"""A listener in a process of its own, whose poses of the arm's hand a test checks."""

import re
import time

from arms import hand
from endings import without_library_lines
from environment import ROOT
import pytest

#: The programs that listen while a test attacks them.
PROGRAM = str(ROOT / 'test' / 'support' / 'attacked.py')


def begin_of(arm):
    """Return the time of t = 0 of an arm (ns), from its log."""
    found = re.search(r't = 0 at (\d+) ns', arm.line_with('t = 0 at'))
    assert found is not None
    return int(found[1])


class Watch:
    """The program that prints the poses of the hand."""

    def __init__(self, start, begins):
        """Start it; `begins` has the time of t = 0 of each arm (ns), and may grow."""
        self.process, self._begins = start(PROGRAM, 'watch'), begins
        self.process.line_with('ready')

    def fresh(self, after):
        """
        Wait for a pose that is newer than a time (ns), and check all poses up to it.

        :returns: how long after that time it was there (s).
        """
        stamp = 0
        while stamp <= after:
            line = self.process.line()
            if not without_library_lines(line):
                assert line, 'the listener has ended'
                continue
            first, *numbers = line.split()
            stamp = int(first)
            begin = max(begin for begin in self._begins if begin <= stamp)
            x, y, z, _, _, yaw = hand([stamp], begin)[0]
            assert [float(number) for number in numbers] == pytest.approx([x, y, z, yaw], abs=1e-6)
        return (time.time_ns() - after) / 1e9
