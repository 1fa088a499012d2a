"""The shapes of the links of a robot, and the poses in its description."""

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple, Optional
from xml.etree import ElementTree

from puretf._text.names import abbreviated, quoted
from puretf.rotations import quaternion_from_euler, signed
from puretf_tools.robot.urdf_text import attribute, DescriptionError, numbers, refuse

#: x, y, z (m) and the quaternion x, y, z, w.
Pose = tuple[float, float, float, float, float, float, float]
#: Red, green, blue and opacity, from 0 to 1.
Rgba = tuple[float, float, float, float]

#: The largest number of shapes that are read, and drawn.
MOST_SHAPES = 2000
#: By kind: the attributes with its size, how many numbers each has, and the default.
_SIZES: dict[str, list[tuple[str, int, Optional[Sequence[float]]]]] = {
    'box': [('size', 3, None)], 'cylinder': [('radius', 1, None), ('length', 1, None)],
    'sphere': [('radius', 1, None)], 'mesh': [('scale', 3, (1.0, 1.0, 1.0))]}


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


def shapes(robot: ElementTree.Element, warnings: list[str]
           ) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
    """Return visuals and collisions; those that are not valid are left out, as by urdfdom."""
    colors = {element.get('name', ''): color for element in robot.findall('material')
              if (color := _color(element)) or element.find('texture') is not None}
    found: dict[str, list[Shape]] = {'visual': [], 'collision': []}
    elements = [(link.attrib['name'], element) for link in robot.findall('link')
                for element in link if element.tag in found]
    for link, element in elements[:MOST_SHAPES]:
        rgba, problem = _rgba(element.find('material'), colors)
        try:
            shape, other = _shape(element, link, rgba)
            found[element.tag].append(shape)
            problem = problem or other
        except DescriptionError as error:
            problem = f'a {element.tag} is left out: {error}'
        if problem:
            warnings.append(f'link {quoted(link)}: {problem}')
    if len(elements) > MOST_SHAPES:
        warnings.append(f'only the first {MOST_SHAPES} shapes are read')
    return tuple(found['visual']), tuple(found['collision'])


def _shape(element: ElementTree.Element, link: str, rgba: Optional[Rgba]) -> tuple[Shape, str]:
    """Return a shape, and which further one is ignored, or ''."""
    geometry = element.find('geometry')
    body, *others = [element] if geometry is None or not len(geometry) else geometry
    kind = body.tag
    if kind not in _SIZES:
        refuse(f'<geometry> must contain one of <{">, <".join(_SIZES)}>'
               + f', got <{abbreviated(kind)}>' * (body is not element))
    size = [number for name, count, default in _SIZES[kind]
            for number in numbers(body, name, kind, count, default)]
    file = attribute(body, kind, 'filename', '<geometry>') if kind == 'mesh' else ''
    return Shape(link, origin(element, kind), kind, tuple(size), file, rgba), (
        f'<geometry> has more than <{kind}>: <{abbreviated(others[0].tag)}> is ignored'
        if others else '')


def origin(element: ElementTree.Element, what: str) -> Pose:
    """Return the pose of a joint or a shape."""
    place = element.find('origin')
    if place is None:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
    (x, y, z), (roll, pitch, yaw) = (
        numbers(place, name, what, 3, (0.0, 0.0, 0.0)) for name in ('xyz', 'rpy'))
    return (x, y, z, *signed(*quaternion_from_euler(roll, pitch, yaw)))


def _rgba(material: Optional[ElementTree.Element], colors: dict[str, Optional[Rgba]]
          ) -> tuple[Optional[Rgba], str]:
    """Return the color of a shape, and why that of its material is ignored, or ''."""
    if material is None:
        return None, ''
    # A link may use a color that another link has defined; the first definition counts.
    name, color = material.get('name', ''), _color(material)
    if color:
        return colors.setdefault(name, color) if name else color, ''
    if name in colors or material.find('texture') is not None:
        return colors.get(name), ''
    return None, f'material {quoted(name)} has no color: rgba must be four numbers from 0 to 1'


def _color(material: ElementTree.Element) -> Optional[Rgba]:
    """Return the color of a material; None if it has none, or one that is not valid."""
    color = material.find('color')
    with suppress(DescriptionError):
        if color is not None:
            red, green, blue, alpha = rgba = numbers(color, 'rgba', '', 4)
            return (red, green, blue, alpha) if 0.0 <= min(rgba) <= max(rgba) <= 1.0 else None
    return None
