"""Times (ns) as seconds and as text."""

#: One second (ns).
SECOND = 1_000_000_000
#: How long a buffer keeps transforms if nothing else is said (ns).
CACHE_TIME = 10 * SECOND


def in_seconds(time: int) -> float:
    """
    Convert nanoseconds to seconds with the rounding of tf2, as in `tf2::timeToSec`.

    >>> in_seconds(1_500_000_000)
    1.5
    """
    fraction = abs(time) % SECOND * (-1 if time < 0 else 1)
    return (time - fraction) // SECOND + 1e-9 * fraction


def display_time(time: int) -> str:
    """Write a time (ns) as seconds with six decimals, as `tf2::displayTimePoint` does."""
    return f'{in_seconds(time):.6f}'


def exact_time(time: int) -> str:
    """
    Write a time (ns) as seconds with nine decimals, without rounding.

    >>> exact_time(1_700_000_000_000_000_001), exact_time(-1_500_000_000)
    ('1700000000.000000001', '-1.500000000')
    """
    whole, fraction = divmod(abs(time), SECOND)
    return f'{"-" if time < 0 else ""}{whole}.{fraction:09d}'
