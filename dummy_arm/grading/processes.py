"""Processes on Linux: the end of all that a program starts."""

from collections.abc import Collection
from contextlib import suppress
import ctypes
import os
import signal
import time

import psutil

#: prctl(2)
_PR_SET_CHILD_SUBREAPER = 36
#: How long to kill processes, until those that are left are given up, and one round of this (s).
_LONGEST_END, _ROUND = 10.0, 0.1


def become_subreaper(is_subreaper: bool = True) -> None:
    """Become the parent of all descendants that lose theirs."""
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, is_subreaper, 0, 0, 0)


def end_descendants(spared: Collection[int] = ()) -> None:
    """
    Kill and reap what this subreaper has started, but for spared children with what they started.

    The children of a process that ends become children of this one. All are killed in each round,
    before it waits for any, since those that are left may start others meanwhile.
    """
    deadline = time.monotonic() + _LONGEST_END
    while time.monotonic() < deadline and (found := descendants(spared)):
        for each in found:
            with suppress(OSError):  # it has ended, or another user owns it
                os.kill(each.pid, signal.SIGKILL)
        psutil.wait_procs(found, _ROUND)


def descendants(spared: Collection[int] = ()) -> list[psutil.Process]:
    """Return what this process has started, but for spared children with what they started."""
    running = [*psutil.process_iter(['ppid', 'memory_info'])]
    found = [each for each in running
             if each.info['ppid'] == os.getpid() and each.pid not in spared]
    for parent in found:  # it grows
        found += [each for each in running if each.info['ppid'] == parent.pid]
    return found
