"""Which clock the stamps are on, and what it shows, by messages of /clock that are made up."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from puretf_tools.inspection.stamp_clock import StampClock

S, MS = 10**9, 10**6
NOW = 1_700_000_000 * S


def clock_of(*messages):
    """Return a simulated clock at NOW; messages: (arrival, time), in s after NOW, and in s."""
    clock = StampClock(lambda: NOW)
    clock.is_simulated = True
    for arrival, time in messages:
        clock.add(NOW + round(arrival * S), round(time * S))
    return clock


def shown(clock, *seconds):
    """Return the times (s) that the clock shows some seconds after NOW."""
    return [time / S for time in clock.at(np.array([NOW + round(each * S) for each in seconds]))]


def test_between_messages_time_is_interpolated():
    """Also with a tenth of the real time, before the first message, and shortly after the last."""
    clock = clock_of((-2, 0), (0, 0.2), (2, 0.4))
    assert shown(clock, -1, 0, 1, 3) == [0.1, 0.2, 0.3, 0.5]
    assert shown(clock, -2.5) == [-0.05]
    assert shown(clock, 60) == [0.8]  # it may be paused: two periods after the last message


def test_a_date_is_exact():
    """Stamps of today have more digits than a float."""
    assert clock_of((0, 0)).at(np.array([NOW + 7])) == [7]
    clock = StampClock()
    clock.is_simulated = True
    for i in range(3):
        clock.add(NOW + i * S, NOW - 3600 * S + i * S)
    assert clock.at(np.array([NOW + S + 7])) == [NOW - 3599 * S + 7]


@pytest.mark.parametrize('after', [5, 5000])
def test_a_jump(after):
    """A simulation that starts again, or a bag that goes on elsewhere, has no time in between."""
    clock = clock_of((0, 100), (1, 101), (2, after), (3, after + 1))
    assert shown(clock, 0.5, 1.5, 2, 2.5) == [100.5, 101, after, after + 0.5]


def test_many_messages():
    """The oldest ones are forgotten."""
    clock = clock_of(*((i / 100, 50 + i / 100) for i in range(30_000)))
    assert shown(clock, 0, 299) == [50, 349]


def test_no_message():
    """Then nothing is known; the system clock is, if it is that of the stamps."""
    clock = clock_of()
    assert (clock.at(np.array([NOW])), clock.now()) == (None, 0)
    clock.is_simulated = False
    assert clock.now() == NOW


@pytest.mark.parametrize(('messages', 'stamps', 'choice'), [
    ([], [NOW - MS], False),
    ([], [100 * S], None),  # /clock may come
    ([(0, 100)], [100 * S], True),
    ([(0, 100)], [99 * S, 41 * S], True),
    ([(0, 100)], [300 * S], None),
    ([(0, NOW / S - 30)], [NOW - 30 * S], True),
    ([(0, NOW / S)], [NOW + 5 * MS], False),  # both fit
    ([(0, 100)], [NOW - 20 * S], False),
    ([(0, 100)], [100 * S, NOW], False),  # as many of both
    ([(0, 100)], [100 * S, 100 * S, NOW], True),
    ([(0, 100)], [NOW - 1_384_035_218 * S], None)])  # the epoch of GPS
def test_the_choice(messages, stamps, choice):
    """It is /clock if most stamps fit it, and not the system clock."""
    assert clock_of(*messages).choice(stamps) is choice


def test_two_threads():
    """One adds while the other one asks."""
    clock = clock_of((0, 0))
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(lambda: [clock.now() for _ in range(200)])
        while not asked.done():
            clock.add(NOW, 0)
    assert set(asked.result()) == {0}
