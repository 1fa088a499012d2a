"""The description of a robot, parsed from URDF; needs no ROS."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from math import hypot, inf
from numbers import Real
import sys
from typing import NamedTuple, Optional
from xml.etree import ElementTree

from puretf import TransformBuffer
from puretf._text.names import comma_list, LONGEST_NAME, quoted
from puretf._text.similar_names import suggest_names
from puretf.exceptions import described
from puretf.rotations import conjugate, multiply, quaternion_about_axis, signed
from puretf_tools.inspection.forest import descend, loops
from puretf_tools.robot.shapes import origin, Pose, Shape, shapes
from puretf_tools.robot.urdf_text import attribute, numbers, refuse, robot_element

#: The types of joints.
KINDS = ('revolute', 'continuous', 'prismatic', 'fixed', 'planar', 'floating')
#: The largest position (rad or m), and the largest multiplier and offset of a mimic.
LARGEST = 1e9
#: The numbers that a joint may have, by element, and their defaults; None: it is required.
_NUMBERS: dict[str, dict[str, Optional[Sequence[float]]]] = {
    'limit': {'lower': [0.0], 'upper': [0.0], 'effort': None, 'velocity': None},
    'mimic': {'multiplier': [1.0], 'offset': [0.0]},
    'dynamics': {'damping': [0.0], 'friction': [0.0]},
    'safety_controller': {'k_velocity': None, 'k_position': [0.0], 'soft_lower_limit': [0.0],
                          'soft_upper_limit': [0.0]},
    'calibration': {'rising': [0.0], 'falling': [0.0]}}


class Mimic(NamedTuple):
    """A joint follows another one: its position is that of `joint` * multiplier + offset."""

    joint: str
    multiplier: float
    offset: float


class Joint(NamedTuple):
    """
    A joint between two links.

    `pose` is the origin of the joint in the frame of the link `parent`, `axis` a unit vector in
    the frame of the joint. `limits` are the lower and upper position (rad or m); None: none.
    """

    name: str
    kind: str
    parent: str
    child: str
    pose: Pose
    axis: tuple[float, float, float]
    limits: Optional[tuple[float, float]]
    mimic: Optional[Mimic]

    @property
    def is_movable(self) -> bool:
        return self.kind in ('revolute', 'continuous', 'prismatic')

    def pose_at(self, position: float) -> Pose:
        """
        Return the pose of the child in the parent at a position (rad or m).

        The quaternion has the sign that robot_state_publisher gives it: w may be negative.
        """
        (x, y, z), q = self.pose[:3], self.pose[3:]
        if self.kind == 'prismatic':
            step = (*(position * component for component in self.axis), 0.0)
            dx, dy, dz, _ = multiply(multiply(q, step), conjugate(q))
            return (x + dx, y + dy, z + dz, *q)
        if self.is_movable:
            return (x, y, z, *signed(*multiply(q, quaternion_about_axis(position, self.axis))))
        return self.pose


class Description(NamedTuple):
    """A robot: a tree of links below `root`; `warnings` say what of the text is left out."""

    name: str
    text: str
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    root: str
    visuals: tuple[Shape, ...]
    collisions: tuple[Shape, ...]
    warnings: tuple[str, ...] = ()

    def poses(self, joint_positions: Mapping[str, float] = {}) -> TransformBuffer:
        """
        Return a buffer with the poses of all links, as static transforms: they hold at all times.

        Limits are not applied, as by robot_state_publisher. A joint with a mimic follows its
        joint, unless it has a position of its own. A planar or floating joint is at its origin.

        :param joint_positions: positions (rad or m) by the names of joints; the other joints are
            at 0.
        :raises TypeError: if the positions are not a mapping to numbers.
        :raises ValueError: if no joint with this name can move, if a position is not between -1e9
            and 1e9, or if a link has a name that no frame can have.
        """
        movable = {joint.name: joint for joint in self.joints if joint.is_movable}
        _check_positions(joint_positions, movable)
        rules = mimic_rules([joint._replace(mimic=None) if joint.name in joint_positions else joint
                             for joint in self.joints])
        buffer = TransformBuffer(max_frames=sys.maxsize, max_samples=None)
        for joint in self.joints:
            master, multiplier, offset = rules.get(joint.name, ('', 0.0, 0.0))
            position = multiplier * float(joint_positions.get(master, 0.0)) + offset
            if not buffer.insert(0, joint.parent, joint.child, joint.pose_at(position),
                                 is_static=True):
                raise ValueError(
                    f'joint {quoted(joint.name)}: {quoted(joint.parent)} and '
                    f'{quoted(joint.child)} cannot be two frames: rename the links; '
                    f'a name has 1 to {LONGEST_NAME} bytes, and its leading slash does not count')
        return buffer


def _check_positions(positions: Mapping[str, float], movable: Mapping[str, Joint]) -> None:
    if not isinstance(positions, Mapping):
        raise TypeError('joint_positions must be a dict of names and positions, such as '
                        f"{{'elbow': 0.5}}, got {described(positions)}")
    for name, position in positions.items():
        if name not in movable:
            raise ValueError(
                f'the robot has no joint {quoted(str(name))} that can move: correct the name, or '
                f'leave it out. {suggest_names(str(name), tuple(movable), "joints")}')
        if not isinstance(position, Real):
            raise TypeError(f'the position of joint {quoted(name)} must be a number (rad or m), '
                            f'got {described(position)}')
        if not abs(position) <= LARGEST:
            raise ValueError(f'the position of joint {quoted(name)} must be between '
                             f'-{LARGEST:g} and {LARGEST:g} (rad or m), got {position}')


def parse(text: str) -> Description:
    """
    Parse a URDF text, by the rules of urdfdom.

    :raises DescriptionError: if the text is not a valid description.
    """
    robot = robot_element(text)
    links = _names(robot, 'link')
    known = dict.fromkeys(_names(robot, 'joint'))
    _names(robot, 'material')
    joints = [*map(_joint, robot.findall('joint'))]
    warnings = [f'joint {quoted(joint.name)} mimics {quoted(joint.mimic.joint)}, which is not a '
                'joint of the robot: correct the name. '
                f'{suggest_names(joint.mimic.joint, tuple(known), "joints")}'
                for joint in joints if joint.mimic and joint.mimic.joint not in known]
    if ignored := sorted({each.tag for each in robot.iter() if each.tag.startswith('xacro:')}):
        warnings.append(f'elements of xacro are ignored: {comma_list(ignored)}; '
                        'in a file *.xacro, xacro expands them, or says why it cannot')
    root, parents = _tree(links, joints, warnings)
    visuals, collisions = shapes(robot, warnings)
    return Description(robot.attrib['name'], text, links,
                       tuple(joint for joint in joints if parents[joint.child] is joint), root,
                       visuals, collisions, tuple(warnings))


def _names(robot: ElementTree.Element, tag: str) -> tuple[str, ...]:
    """Return the names of links, joints or materials; each must have one of its own."""
    names: dict[str, None] = {}
    for element in robot.findall(tag):
        name = element.get('name', '' if tag == 'material' else None)
        if name is None:
            refuse(f'a {tag} has no name: write <{tag} name="...">')
        if name in names:
            refuse(f'two {tag}s have the name {quoted(name)}: names must be unique')
        names[name] = None
    if not names and tag == 'link':
        refuse('the robot has no link: write <link name="..."/>')
    return tuple(names)


def _joint(element: ElementTree.Element) -> Joint:
    name, kind = element.attrib['name'], element.get('type')
    what = f'joint {quoted(name)}'
    if kind not in KINDS:
        refuse(f'{what}: the type must be one of {", ".join(KINDS)}, got {kind!r:.100}')
    parts = {tag: part for tag in ('parent', 'child', 'axis', *_NUMBERS)
             if (part := element.find(tag)) is not None}
    found = {tag: {name: numbers(part, name, what, 1, default)[0]
                   for name, default in _NUMBERS[tag].items()}
             for tag, part in parts.items() if tag in _NUMBERS}
    if 'limit' not in found and kind in ('revolute', 'prismatic'):
        refuse(f'{what} has no limit: a {kind} joint needs <limit lower="..." upper="..." '
               'effort="..." velocity="..."/>')
    if 'dynamics' in parts and not _NUMBERS['dynamics'].keys() & parts['dynamics'].attrib.keys():
        refuse(f'{what}: <dynamics> needs damping or friction')
    axis: Sequence[float] = (1.0, 0.0, 0.0)
    if 'axis' in parts and kind not in ('fixed', 'floating'):
        axis = numbers(parts['axis'], 'xyz', what, 3)
    length = hypot(*axis)
    if not 0.0 < length < inf:
        refuse(f'{what}: the axis must have a finite length that is not 0, got '
               f'{" ".join(map(str, axis))}: write for example <axis xyz="0 0 1"/>')
    parent, child = (attribute(parts.get(tag), tag, 'link', what) for tag in ('parent', 'child'))
    return Joint(
        name, kind, parent, child, origin(element, what),
        (axis[0] / length, axis[1] / length, axis[2] / length),
        (found['limit']['lower'], found['limit']['upper']) if kind in ('revolute', 'prismatic')
        else None,
        Mimic(attribute(parts['mimic'], 'mimic', 'joint', what), **found['mimic'])
        if 'mimic' in parts else None)


def _tree(links: Sequence[str], joints: Iterable[Joint], warnings: list[str]
          ) -> tuple[str, dict[str, Joint]]:
    """Return the root and, by link, the joint to its parent, or refuse what is not a tree."""
    parents: dict[str, Joint] = {}
    known = {*links} - {''}  # which urdfdom takes for a missing name
    for joint in sorted(joints, key=lambda joint: joint.name):
        for role, link in ('parent', joint.parent), ('child', joint.child):
            if link not in known:
                refuse(f'joint {quoted(joint.name)}: the {role} {quoted(link)} is not a link of '
                       'the robot: write <link name="..."/>, or correct the name. '
                       f'{suggest_names(link, tuple(links), "links")}')
        if joint.parent == joint.child:
            refuse(f'joint {quoted(joint.name)} connects the link {quoted(joint.child)} with '
                   'itself: parent and child must differ')
        if joint.child in parents:  # urdfdom takes the last one
            warnings.append(f'the link {quoted(joint.child)} has two parents: joint '
                            f'{quoted(parents[joint.child].name)} is ignored')
        parents[joint.child] = joint
    roots = [link for link in links if link not in parents]
    if not roots:
        refuse('the robot has no root: each link is the child of a joint, so joints form a loop')
    if len(roots) > 1:
        refuse(f'the robot has {len(roots)} roots, {comma_list(roots, quoted)}: connect them '
               'by joints to one tree')
    if loop := sorted(known - descend(parents, {roots[0]: None}, lambda *_: None).keys()):
        refuse(f'joints form a loop, so that these links are not below the root '
               f'{quoted(roots[0])}: {comma_list(loop, quoted)}')
    return roots[0], parents


class _Follower(NamedTuple):
    parent: str  #: the joint that it follows
    multiplier: float
    offset: float


def mimic_rules(joints: Iterable[Joint]) -> dict[str, Mimic]:
    """
    Return, by the name of each movable joint, how it follows a free joint.

    A joint is free, and follows itself, if it has no mimic, or that of itself, in a loop, of a
    joint that cannot move, or with numbers above `LARGEST`.
    """
    movable = {joint.name: joint for joint in joints if joint.is_movable}
    followers = {name: _Follower(*joint.mimic) for name, joint in movable.items()
                 if joint.mimic and joint.mimic.joint in movable}
    in_loops = chain(*loops({name: each.parent for name, each in followers.items()}))
    free = movable.keys() - followers.keys() | {*in_loops}

    def rule(name: str, followed: Mimic) -> Mimic:
        (_, factor, summand), (master, multiplier, offset) = followers[name], followed
        multiplier, offset = factor * multiplier, factor * offset + summand
        is_sane = abs(multiplier) <= LARGEST and abs(offset) <= LARGEST
        return Mimic(master, multiplier, offset) if is_sane else Mimic(name, 1.0, 0.0)

    rules = descend(followers, {name: Mimic(name, 1.0, 0.0) for name in free}, rule)
    return {name: rules[name] for name in movable}
