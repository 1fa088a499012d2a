"""The description of a robot, parsed from URDF; needs no ROS."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from math import hypot, isfinite
import re
from threading import Lock
from typing import Any, NamedTuple, Optional
from xml.etree import ElementTree

from puretf import abbreviated, comma_list, quoted, suggest_names
from puretf.rotations import conjugate, multiply, quaternion_about_axis, quaternion_from_euler
from puretf_tools.inspection.forest import descend
from puretf_tools.robot.urdf_text import (
    BLANKS,
    DescriptionError,
    IS_XACRO,
    refuse,
    robot_element,
)

#: x, y, z (m) and the quaternion x, y, z, w.
Pose = tuple[float, float, float, float, float, float, float]
#: Red, green, blue and opacity, from 0 to 1.
Rgba = tuple[float, float, float, float]

#: The types of joints.
KINDS = ('revolute', 'continuous', 'prismatic', 'fixed', 'planar', 'floating')
MOVABLE = ('revolute', 'continuous', 'prismatic')
_NUMBER = re.compile(r'[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?', re.ASCII)
#: The longest number (characters), and the largest number of shapes that are read.
_LONGEST_NUMBER, _MOST_SHAPES = 100, 10_000
_VECTORS = ('xyz', 'rpy', 'size', 'scale')
#: The attributes that are numbers, by element.
_NUMERIC = {
    'origin': ('xyz', 'rpy'), 'axis': ('xyz',), 'mimic': ('multiplier', 'offset'),
    'limit': ('lower', 'upper', 'effort', 'velocity'), 'dynamics': ('damping', 'friction'),
    'safety_controller': ('k_velocity', 'k_position', 'soft_lower_limit', 'soft_upper_limit'),
    'calibration': ('rising', 'falling'), 'box': ('size',), 'cylinder': ('radius', 'length'),
    'sphere': ('radius',), 'mesh': ('scale',)}
_PARSER_MISSING = ("urdf_parser_py is missing: pip install 'dummy-arm[robot]', or apt install "
                   'ros-jazzy-urdfdom-py')
#: Held while a function of urdf_parser_py, which is global, is replaced.
_lock = Lock()


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
        """True for revolute, continuous and prismatic joints."""
        return self.kind in MOVABLE

    def pose_at(self, position: float) -> Pose:
        """
        Return the pose of the child in the parent at a position (rad or m).

        The quaternion has the sign that robot_state_publisher gives it: w may be negative.
        """
        x, y, z, *q = self.pose
        if self.kind == 'prismatic':
            step = (*(position * component for component in self.axis), 0.0)
            dx, dy, dz, _ = multiply(multiply(q, step), conjugate((q[0], q[1], q[2], q[3])))
            return _pose((x + dx, y + dy, z + dz), q)
        if self.is_movable:
            return _pose((x, y, z), multiply(q, quaternion_about_axis(position, self.axis)))
        return self.pose


class Shape(NamedTuple):
    """
    A visual or collision shape of a link.

    `pose` is in the frame of the link. `kind` and `size` (m): 'box' x, y, z; 'cylinder' radius,
    length; 'sphere' radius; 'mesh' the scales along x, y, z, and `file` is its file or address.
    """

    link: str
    pose: Pose
    kind: str
    size: tuple[float, ...]
    file: str
    rgba: Optional[Rgba]


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


def parse(text: str) -> Description:
    """
    Parse a URDF text, by the rules of urdfdom.

    :raises DescriptionError: if the text is not a valid description.
    """
    robot = robot_element(text)
    links = _names(robot, 'link')
    _names(robot, 'joint')
    _names(robot, 'material')
    with _silent_parser() as urdf:
        joints = [_joint(element, urdf) for element in robot.findall('joint')]
        known = dict.fromkeys(joint.name for joint in joints)
        warnings = [f'joint {quoted(joint.name)} mimics {quoted(joint.mimic.joint)}, which is not '
                    'a joint of the robot: correct the name. '
                    f'{suggest_names(joint.mimic.joint, tuple(known), "joints")}'
                    for joint in joints if joint.mimic and joint.mimic.joint not in known]
        if ignored := sorted({each.tag for each in robot.iter() if each.tag.startswith('xacro:')}):
            warnings.append(f'elements of xacro are ignored: {comma_list(ignored, 5)}; '
                            'in a file *.xacro, xacro expands them, or says why it cannot')
        root, parents = _tree(links, joints, warnings)
        visuals, collisions = _shapes(robot, urdf, warnings)
    return Description(robot.get('name', ''), text, links,
                       tuple(joint for joint in joints if parents[joint.child] is joint), root,
                       visuals, collisions, tuple(warnings))


def _names(robot: ElementTree.Element, tag: str) -> tuple[str, ...]:
    """Return the names of the links or joints; each must have one of its own."""
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


@contextmanager
def _silent_parser() -> Iterator[Any]:
    """Yield the module of urdf_parser_py, which else prints what it does not know."""
    try:
        from urdf_parser_py import urdf
        from urdf_parser_py.xml_reflection import core
    except ImportError:
        refuse(f'cannot parse the robot description: {_PARSER_MISSING}')
    with _lock:
        before, core.on_error = core.on_error, lambda text: None
        try:
            yield urdf
        finally:
            core.on_error = before


def _from_xml(kind: Any, element: ElementTree.Element, what: str) -> Any:
    """Parse an element by a class of urdf_parser_py; check what it does not check."""
    from urdf_parser_py.xml_reflection.core import ParseError
    from urdf_parser_py.xml_reflection.core import Path as XmlPath
    for part in element.iter():
        for attribute in _NUMERIC.get(part.tag, ()):
            value = part.get(attribute)
            if value is not None:
                _check_numbers(value, attribute in _VECTORS,
                               f'{what}: {attribute} of <{part.tag}>')
    # urdf_parser_py takes the first element of each kind, but quadratic time for the others, and
    # writes the name for each element that it does not know.
    first: dict[str, ElementTree.Element] = {}
    for part in element:
        first.setdefault(part.tag, part)
    element[:] = first.values()
    element.set('name', '')
    try:
        return kind.from_xml(element, XmlPath(element.tag))
    except ParseError as error:
        refuse(f'{what}: {abbreviated(str(error.e), 300)} (in <{error.path.tag}>)')
    except Exception as error:  # it also raises AssertionError, AttributeError, ...
        refuse(f'{what}: {abbreviated(str(error), 300)}')


def _check_numbers(value: str, is_vector: bool, what: str) -> None:
    texts = re.split(f'[{BLANKS}]+', value.strip(BLANKS))
    if len(texts) != (3 if is_vector else 1) or not all(map(_is_number, texts)):
        needed = 'three numbers with blanks between them' if is_vector else 'a number'
        refuse(f'{what} must be {needed}, got {quoted(value)}' + (
            f'; {IS_XACRO}' if '${' in value else ''))


def _is_number(text: str) -> bool:
    return (len(text) <= _LONGEST_NUMBER and _NUMBER.fullmatch(text) is not None
            and isfinite(float(text)))


def _joint(element: ElementTree.Element, urdf: Any) -> Joint:
    name, kind = element.attrib['name'], element.get('type')
    what = f'joint {quoted(name)}'
    if kind not in KINDS:
        refuse(f'{what}: the type must be one of {", ".join(KINDS)}, got {kind!r:.100}')
    for tag in 'parent', 'child':
        link = element.find(tag)
        if link is None or not link.get('link'):
            refuse(f'{what} has no {tag}: write <{tag} link="..."/>')
    if kind in ('revolute', 'prismatic') and element.find('limit') is None:
        refuse(f'{what} has no limit: a {kind} joint needs <limit lower="..." upper="..." '
                'effort="..." velocity="..."/>')
    axis_element, dynamics = element.find('axis'), element.find('dynamics')
    if axis_element is not None and kind in ('fixed', 'floating'):
        element.remove(axis_element)
    elif axis_element is not None and axis_element.get('xyz') is None:
        refuse(f'{what}: the axis has no xyz: write <axis xyz="0 0 1"/>')
    if dynamics is not None and not {'damping', 'friction'} & dynamics.attrib.keys():
        refuse(f'{what}: <dynamics> needs damping or friction')
    joint = _from_xml(urdf.Joint, element, what)
    axis = joint.axis or (1.0, 0.0, 0.0)
    length = hypot(*axis)
    if length == 0.0 or not isfinite(length):
        refuse(f'{what}: the axis must have a finite length that is not 0, got '
                f'{" ".join(map(str, axis))}: write for example <axis xyz="0 0 1"/>')
    return Joint(
        name, kind, joint.parent, joint.child, _origin(joint.origin),
        (axis[0] / length, axis[1] / length, axis[2] / length),
        (float(joint.limit.lower), float(joint.limit.upper)) if kind in ('revolute', 'prismatic')
        else None,
        joint.mimic and Mimic(joint.mimic.joint, _or(joint.mimic.multiplier, 1.0),
                              _or(joint.mimic.offset, 0.0)))


def _or(value: Optional[float], default: float) -> float:
    return default if value is None else value


def _origin(origin: Any) -> Pose:
    if origin is None:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
    return _pose([*map(float, origin.xyz)], quaternion_from_euler(*origin.rpy))


def _pose(position: Sequence[float], rotation: Sequence[float]) -> Pose:
    """Return a pose with the sign of KDL::Rotation::GetQuaternion."""
    x, y, z, w = rotation
    if 4.0 * w * w - 1.0 > 1e-12:  # the trace of the matrix
        sign = w
    elif x * x > max(y * y, z * z):
        sign = x
    else:
        sign = y if y * y > z * z else z
    if sign < 0.0:
        x, y, z, w = -x, -y, -z, -w
    return position[0], position[1], position[2], x, y, z, w


def _tree(links: Sequence[str], joints: Iterable[Joint], warnings: list[str]
          ) -> tuple[str, dict[str, Joint]]:
    """Return the root and, by link, the joint to its parent, or refuse what is not a tree."""
    parents: dict[str, Joint] = {}
    known = {*links}
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
        refuse(f'the robot has {len(roots)} roots, {comma_list(roots, 5, quoted)}: connect them '
                'by joints to one tree')
    if loop := sorted(known - descend(parents, {roots[0]: None}, lambda *_: None).keys()):
        refuse(f'joints form a loop, so that these links are not below the root '
                f'{quoted(roots[0])}: {comma_list(loop, 5, quoted)}')
    return roots[0], parents


def _shapes(robot: ElementTree.Element, urdf: Any, warnings: list[str]
            ) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
    """Return visuals and collisions; those that are not valid are left out, as by urdfdom."""
    colors: dict[str, Optional[Rgba]] = {
        element.get('name', ''): color for element in robot.findall('material')
        if (color := _color(element)) or element.find('texture') is not None}
    shapes: dict[str, list[Shape]] = {'visual': [], 'collision': []}
    elements = [(link.attrib['name'], element) for link in robot.findall('link')
                for element in link if element.tag in shapes]
    for name, element in elements[:_MOST_SHAPES]:
        material = element.find('material')
        if material is not None:
            element.remove(material)
        rgba, problem = _rgba(material, colors)
        try:
            shapes[element.tag].append(_shape(element, name, urdf, rgba, warnings))
        except DescriptionError as error:
            problem = f'a {element.tag} is left out: {error}'
        if problem:
            warnings.append(f'link {quoted(name)}: {problem}')
    if len(elements) > _MOST_SHAPES:
        warnings.append(f'only the first {_MOST_SHAPES} shapes are read')
    return tuple(shapes['visual']), tuple(shapes['collision'])


def _shape(element: ElementTree.Element, link: str, urdf: Any, rgba: Optional[Rgba],
           warnings: list[str]) -> Shape:
    geometry = element.find('geometry')
    if geometry is None or not len(geometry):
        refuse('<geometry> must contain one of <box>, <cylinder>, <sphere>, <mesh>')
    kind = geometry[0].tag
    if len(geometry) > 1:
        warnings.append(f'link {quoted(link)}: <geometry> has more than <{abbreviated(kind)}>: '
                        f'<{abbreviated(geometry[1].tag)}> is ignored')
        del geometry[1:]
    shape = _from_xml(urdf.Visual if element.tag == 'visual' else urdf.Collision, element, kind)
    body = shape.geometry
    size = (body.size if kind == 'box' else (body.radius, body.length) if kind == 'cylinder' else
            (body.radius,) if kind == 'sphere' else body.scale or (1.0, 1.0, 1.0))
    return Shape(link, _origin(shape.origin), kind, tuple(size), getattr(body, 'filename', ''),
                 rgba)


def _rgba(material: Optional[ElementTree.Element], colors: dict[str, Optional[Rgba]]
          ) -> tuple[Optional[Rgba], str]:
    """Return the color of a shape, and why that of its material is ignored, or ''."""
    if material is None:
        return None, ''
    # A link may use a color that another link has defined; the first definition counts.
    name, color = material.get('name', ''), _color(material)
    if color:
        return colors.setdefault(name, color) if name else color, ''
    color, problem = colors.get(name), ''
    if material.find('texture') is None:
        if material.find('color') is not None:
            problem = 'a color is ignored: rgba must be four numbers from 0 to 1'
        elif name not in colors:
            problem = f'there is no material {quoted(name)} with a color'
    return color, problem


def _color(material: ElementTree.Element) -> Optional[Rgba]:
    """Return the color of a material; None if it has none, or one that is not valid."""
    color = material.find('color')
    texts = [] if color is None else color.get('rgba', '').split()
    if len(texts) != 4 or not all(map(_is_number, texts)):
        return None
    red, green, blue, alpha = map(float, texts)
    return (red, green, blue, alpha) if all(0.0 <= part <= 1.0 for part in
                                            (red, green, blue, alpha)) else None
