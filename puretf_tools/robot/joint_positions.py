"""The positions of the movable joints of a robot; needs no ROS."""

from collections.abc import Mapping
from math import isfinite, pi, remainder, tau

from puretf_tools.robot.description import Description, Joint, LARGEST, mimic_rules


def bounds(joint: Joint) -> tuple[float, float]:
    """Return the smallest and the largest position (rad or m); of a continuous joint, ±pi."""
    lower, upper = sorted(min(max(each, -LARGEST), LARGEST) for each in joint.limits or (-pi, pi))
    return lower, upper


class JointPositions:
    """
    The positions of the movable joints (rad or m).

    `free` are the joints that can be set, by name; the others follow them by `mimic_rules`.
    """

    def __init__(self, description: Description, before: Mapping[str, float] = {}) -> None:
        """Start at the positions `before` where they are known, else in the centre."""
        self.description = description
        self._rules = mimic_rules(description.joints)
        self.free = {joint.name: joint for joint in description.joints
                     if joint.name in self._rules and self._rules[joint.name].joint == joint.name}
        self._values: dict[str, float] = {}
        self.centre()
        for name, position in before.items():
            self.set(name, position)

    def __getitem__(self, name: str) -> float:
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
