"""The positions of the movable joints of a robot; needs no ROS."""

from collections.abc import Mapping
from math import isfinite, pi, remainder, tau

from dummy_arm.robot.description import Description, Joint


def bounds(joint: Joint) -> tuple[float, float]:
    """Return the smallest and the largest position (rad or m); of a continuous joint, ±pi."""
    lower, upper = sorted(joint.limits or (-pi, pi))
    return lower, upper


class JointPositions:
    """
    The positions of the movable joints (rad or m).

    `free` are the joints that can be set, by name; the others follow them as their mimics. A mimic
    of itself, of a loop, or of a joint that cannot move is free.
    """

    def __init__(self, description: Description, before: Mapping[str, float] = {}) -> None:
        """Start at the positions `before` where they are known, else in the centre."""
        self.description = description
        movable = {joint.name: joint for joint in description.joints if joint.is_movable}
        #: By the name of each movable joint: the free joint, the multiplier and the offset.
        self._rules = {name: _rule(joint, movable) for name, joint in movable.items()}
        self.free = {name: movable[name] for name, (master, _, _) in self._rules.items()
                     if master == name}
        self._values: dict[str, float] = {}
        self.centre()
        for name, position in before.items():
            self.set(name, position)

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


def _rule(joint: Joint, movable: Mapping[str, Joint]) -> tuple[str, float, float]:
    name, multiplier, offset, passed = joint.name, 1.0, 0.0, {joint.name}
    while (mimic := movable[name].mimic) and mimic.joint in movable:
        name = mimic.joint
        if name in passed:
            return joint.name, 1.0, 0.0
        passed.add(name)
        offset += multiplier * mimic.offset
        multiplier *= mimic.multiplier
    return name, multiplier, offset
