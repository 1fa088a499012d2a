"""Fit a sine to the angles of a joint."""

from math import hypot, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: The smallest number of samples that show a wave.
FEWEST = 20
#: The largest residual of a sine; a triangle wave has 0.08, and 0.076 if 0.8 periods are seen.
_LARGEST_RESIDUAL = 0.02
#: The largest angular frequency that is looked for (rad/s).
FASTEST = 20.0
#: How much of an observation is looked at (s), if it has enough samples; and the largest number of
#: samples that are used to look for the speed.
_LONGEST, _MOST_SAMPLES = 120.0, 1000


class Sine(NamedTuple):
    """A sine with a constant term."""

    amplitude: float  #: rad
    speed: float  #: the angular frequency: the speed of the phase (rad/s)
    phase: float  #: the phase at the first time (rad)
    residual: float  #: the root mean square of the residuals, divided by the amplitude
    periods: float  #: the number of periods between the first and the last time
    has_fixed_step: bool = False  #: True if it is one of the number of the message

    @property
    def is_exact(self) -> bool:
        return self.residual < _LARGEST_RESIDUAL

    @property
    def span(self) -> float:
        """The time from the first to the last angle (s)."""
        return self.periods * 2 * pi / self.speed

    @property
    def fastest(self) -> float:
        """The largest speed of the joint (rad/s)."""
        return self.amplitude * self.speed


def fit_sine(times: Floats, angles: Floats) -> Sine:
    """
    Fit c + a sin(speed t) + b cos(speed t) to angles by least squares.

    The speed is searched on a grid, and then, again and again, on a finer one around the best
    speed. In a long observation, only its beginning counts.

    :param times: (n,) times (s), n >= 20, in ascending order.
    :param angles: (n,) angles (rad), which are not all equal.
    """
    t = times - times[0]
    count = int(np.searchsorted(t, max(_LONGEST, t[FEWEST - 1]), 'right'))
    t, angles = t[:count], angles[:count]
    every = -(-count // _MOST_SAMPLES)
    few, y = t[::every], angles[::every]
    step = pi / (4 * t[-1])
    fastest = min(FASTEST, 0.9 * pi * (count - 1) / t[-1])

    def residual_of(speed: float) -> float:
        return fit(_columns(few, speed), y)[1]

    speed = min(np.arange(step, fastest, step).tolist(), key=residual_of)
    for width in step * 0.1 ** np.arange(8):
        speeds = np.linspace(max(speed - width, step / 2), min(speed + width, fastest), 21)
        speed = min(speeds.tolist(), key=residual_of)
    (_, a, b), residual = fit(_columns(t, speed), angles)
    amplitude = max(hypot(a, b), 1e-12)
    return Sine(amplitude, speed, float(np.arctan2(b, a)), residual / amplitude,
                speed * t[-1] / (2 * pi))


def _columns(t: Floats, speed: float) -> Floats:
    return np.column_stack([np.ones_like(t), np.sin(speed * t), np.cos(speed * t)])


def fit(columns: Floats, y: Floats) -> tuple[Floats, float]:
    """Return the least-squares coefficients, and the root mean square of the residuals."""
    found = np.asarray(np.linalg.lstsq(columns, y, rcond=None)[0], np.float64)
    return found, float(np.sqrt(np.mean((columns @ found - y) ** 2)))
