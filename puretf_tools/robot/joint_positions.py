"""The positions of the movable joints of a robot; needs no ROS."""

from collections.abc import Mapping
from math import isfinite, pi, remainder, tau

from puretf_tools.robot.description import Description, Joint

#: The largest position (rad or m), and the largest multiplier and offset of a mimic.
LARGEST = 1e9


def bounds(joint: Joint) -> tuple[float, float]:
    """Return the smallest and the largest position (rad or m); of a continuous joint, ±pi."""
    lower, upper = sorted(min(max(each, -LARGEST), LARGEST) for each in joint.limits or (-pi, pi))
    return lower, upper


class JointPositions:
    """
    The positions of the movable joints (rad or m).

    `free` are the joints that can be set, by name; the others follow them as their mimics. A mimic
    of itself, in a loop, of a joint that cannot move, or with numbers above `LARGEST` is free.
    """

    def __init__(self, description: Description, before: Mapping[str, float] = {}) -> None:
        """Start at the positions `before` where they are known, else in the centre."""
        self.description = description
        movable = {joint.name: joint for joint in description.joints if joint.is_movable}
        #: By the name of each movable joint: the free joint, the multiplier and the offset.
        self._rules = _rules(movable)
        self.free = {name: movable[name] for name, (master, _, _) in self._rules.items()
                     if master == name}
        self._values: dict[str, float] = {}
        self.centre()
        for name, position in before.items():
            self.set(name, position)

    @property
    def masters(self) -> dict[str, str]:
        """By the name of each movable joint: the free joint that it follows, or is."""
        return {name: master for name, (master, _, _) in self._rules.items()}

    def __getitem__(self, name: str) -> float:
        """Return the position of a free joint."""
        return self._values[name]

    def set(self, name: str, position: float) -> None:
        """Set a position, clamped to the limits; ignore other joints and what is not finite."""
        joint = self.free.get(name)
        if joint is None or not isfinite(position):
            return
        lower, upper = bounds(joint)
        if joint.kind == 'continuous' and not lower <= position <= upper:
            position = remainder(position, tau)
        self._values[name] = min(max(position, lower), upper)

    def centre(self) -> None:
        """Set each free joint to 0 if its limits allow it, else to the middle between them."""
        for name, joint in self.free.items():
            lower, upper = bounds(joint)
            self._values[name] = 0.0 if lower <= 0.0 <= upper else lower / 2.0 + upper / 2.0

    def all(self) -> dict[str, float]:
        """Return the positions of all movable joints, in the order of the description."""
        return {name: multiplier * self._values[master] + offset
                for name, (master, multiplier, offset) in self._rules.items()}


def _rules(movable: Mapping[str, Joint]) -> dict[str, tuple[str, float, float]]:
    rules: dict[str, tuple[str, float, float]] = {}
    for name in movable:
        path: list[str] = []
        passed: set[str] = set()
        while name not in rules and name not in passed:
            path.append(name)
            passed.add(name)
            mimic = movable[name].mimic
            if mimic is None or mimic.joint not in movable:
                rules[name] = name, 1.0, 0.0
            else:
                name = mimic.joint
        if name not in rules:  # a loop
            for each in path[path.index(name):]:
                rules[each] = each, 1.0, 0.0
        for each in reversed(path):
            if each not in rules and (mimic := movable[each].mimic):
                master, multiplier, offset = rules[mimic.joint]
                multiplier *= mimic.multiplier
                offset = mimic.multiplier * offset + mimic.offset
                is_sane = abs(multiplier) <= LARGEST and abs(offset) <= LARGEST
                rules[each] = (master, multiplier, offset) if is_sane else (each, 1.0, 0.0)
    return {name: rules[name] for name in movable}
