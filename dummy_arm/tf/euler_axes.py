"""The 24 conventions of Euler angles: about which axes, in which order, fixed or not."""

from itertools import product
from typing import Union

#: First axis, parity, repetition, frame, as in K. Shoemake, Euler Angle Conversion, Graphics
#: Gems IV (1994).
Code = tuple[int, int, int, int]
#: Such as 'sxyz' or (0, 0, 0, 0).
Axes = Union[str, Code]


def _all_codes() -> dict[Axes, Code]:
    """List the codes of all conventions, by their names and by themselves."""
    codes: dict[Axes, Code] = {}
    for i, parity, repetition, frame in product(range(3), range(2), range(2), range(2)):
        j = (i + 1 + parity) % 3
        order = [i, j, i if repetition else 3 - i - j]
        name = ''.join('xyz'[axis] for axis in (reversed(order) if frame else order))
        codes['sr'[frame] + name] = codes[i, parity, repetition, frame] = (
            i, parity, repetition, frame)
    return codes


_CODES = _all_codes()


def code_of(axes: Axes) -> Code:
    """
    Find the code of a convention.

    :raises ValueError: when there is no such convention.
    """
    try:
        return _CODES[axes.lower() if isinstance(axes, str) else axes]
    except (KeyError, TypeError):
        raise ValueError(
            "axes must be 's' (they stay) or 'r' (they turn with the body) and three of x, y, z, "
            "neighbours differing, such as 'sxyz', 'rzyx' or 'szxz', or the code of such, as "
            f'(0, 0, 0, 0) is of sxyz; got {axes!r}') from None
