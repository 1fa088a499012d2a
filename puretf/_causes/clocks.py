"""Offsets of clocks that people know."""

from puretf._text.times import SECOND

#: Stamps before this (ns, three years) begin when something is switched on, or are simulated.
SINCE_START = 100_000_000 * SECOND
#: By name: an offset and its tolerance (s). TAI and GPS time are ahead of UTC; the sources are
#: Bulletin C of the IERS (TAI-UTC = 37 s since 2017) and IS-GPS-200 (GPS epoch: 1980-01-06).
_OFFSETS = {'TAI - UTC': (37.0, 0.1),
            'GPS - UTC': (18.0, 0.1),
            'the GPS epoch': (315_964_800.0, 60.0)}
# Time zones differ by hours, and some by 30 or 45 minutes more.
_OFFSETS |= {f'{minutes // 60}:{minutes % 60:02} h: a time zone': (60.0 * minutes, 0.1)
             for minutes in range(60, 14 * 60 + 1, 15) if minutes % 60 != 15}
#: By unit of time: its length (ns).
UNITS = {'seconds': SECOND, 'milliseconds': 1_000_000, 'microseconds': 1000}
DAY = 86_400 * SECOND
#: What is stamped arrives up to this time (s) later.
_LATENCY = 0.6


def is_off(offset: int, stamp: int, now: int) -> bool:
    """
    Return whether a stamp is of another clock than the one which is `now`; times are in ns.

    :param offset: the stamp minus the time at which its message has arrived.
    """
    # Nothing can have been measured at a time ahead of the clock.
    return (bool(known_offset(offset)) or stamp < SINCE_START < now if offset < 0 else
            offset > SECOND)


def apart(offset: int, stamp: int) -> str:
    """Return how far a stamp is from a clock, and what such an offset is."""
    name = known_offset(offset)
    if not name and offset < 0 < stamp < SINCE_START:
        unit = unit_of(stamp, stamp - offset)
        name = f'{unit} as nanoseconds' if unit else 'near 0, as since power-on'
    return (f'{abs(offset) / SECOND:.1f} s{f" ({name})" if name else ""} '
            f'{"ahead of" if offset > 0 else "behind"}')


def unit_of(stamp: int, time: int) -> str:
    """Return the unit in which a stamp is within a day of a time (ns); '' if there is none."""
    return next((unit for unit, size in UNITS.items() if abs(stamp * size - time) < DAY), '')


def known_offset(offset: int) -> str:
    """
    Return what an offset (ns) of a stamp from a clock is known for; '' if it is nothing special.

    >>> known_offset(-37 * SECOND), known_offset(8 * 3600 * SECOND), known_offset(SECOND)
    ('TAI - UTC', '8:00 h: a time zone', '')
    >>> known_offset(-19800 * SECOND), known_offset(900 * SECOND)
    ('5:30 h: a time zone', '')
    """
    seconds, sign = abs(offset) / SECOND, -1 if offset < 0 else 1
    return next((name for name, (known, tolerance) in _OFFSETS.items()
                 if -tolerance <= (known - seconds) * sign <= tolerance + _LATENCY), '')
