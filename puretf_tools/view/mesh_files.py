"""
What a file of a mesh declares, compared with what it holds, before a library allocates memory.

The libraries get the text that was checked, not that of the file.
"""

from collections import Counter
from collections.abc import Iterable
import json
from math import isfinite
import re
import struct
from typing import Any, NoReturn
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from puretf._text.names import quoted
from puretf_tools.robot.urdf_text import HAS_DOCTYPE

#: The largest size of a file (bytes).
MAX_BYTES = 50_000_000
#: The largest number of triangles of a mesh.
_MAX_FACES = 2_000_000
#: The largest number of vertices, and of corners of polygons.
_MAX_CORNERS = 3 * _MAX_FACES
#: The largest number of elements of COLLADA, and of objects of glTF: trimesh takes seconds.
_MAX_ELEMENTS, _MAX_OBJECTS = 50_000, 20_000
#: By format: what each part has, and the largest number of these: trimesh takes seconds for them,
#: and mostly four times as long for twice as many.
_PARTS = {'.glb': (b'{', _MAX_OBJECTS), '.dae': (b'<', _MAX_ELEMENTS), '.obj': (b'usemtl', 2000),
          '.stl': (b'solid', 4000), '.ply': (b'property', 300)}
#: The largest number of elements of an accessor of glTF that has no data.
_MAX_WITHOUT_DATA = 1_000_000
#: The largest sizes of the JSON of glTF, and of all its views and accessors (bytes).
_MAX_JSON, _MAX_ACCESSED = 5_000_000, 200_000_000
#: The most nodes of glTF one below another: trimesh takes time for each at each mesh.
_MAX_DEPTH = 100
#: The size (bytes) of a component type of glTF, and the numbers of an element of a type.
_SIZES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_NUMBERS = {'SCALAR': 1, 'VEC2': 2, 'VEC3': 3, 'VEC4': 4, 'MAT2': 4, 'MAT3': 9, 'MAT4': 16}
#: What is used of COLLADA, the most numbers of an element of a source (a color has four), and the
#: most sources of polygons.
_LIBRARIES = ('library_images', 'library_effects', 'library_materials',
              'library_geometries', 'library_visual_scenes', 'scene')
_MAX_PARAMS, _MAX_INPUTS = 4, 32
#: So much of a file is parsed at a time (bytes).
_PIECE = 100_000

Element = ElementTree.Element


class MeshError(Exception):
    """A mesh cannot be shown; the text says why, and what to do."""


def _refuse_parts() -> NoReturn:
    raise MeshError('it has too many parts: join them in another program')


def check_size(faces: int, corners: int) -> None:
    """Refuse too many triangles, or vertices or corners of polygons."""
    if faces > _MAX_FACES or corners > _MAX_CORNERS:
        raise MeshError(f'it has more than {_MAX_FACES} triangles or {_MAX_CORNERS} vertices: '
                        'simplify it')


def checked(kind: str, data: bytes) -> tuple[bytes, float]:
    """Return the data of a file for trimesh, and their unit (m); `kind`: the end of its name."""
    mark, most = _PARTS.get(kind, (b' ', MAX_BYTES))
    # A .glb file begins with JSON, whose length is known; the mark may occur in what follows.
    parts_in = data[:20 + int.from_bytes(data[12:16], 'little')] if kind == '.glb' else data
    if parts_in.lower().count(mark) > most:
        _refuse_parts()
    if kind == '.dae':
        return _collada(data)
    if kind == '.ply':
        _check_ply(data)
    return _glb(data) if kind == '.glb' else data, 1.0


# COLLADA


def _collada(data: bytes) -> tuple[bytes, float]:
    """Return the meshes and scenes of COLLADA, without instances of nodes, and its unit (m)."""
    parser = ElementTree.XMLParser(target=_Builder())
    for begin in range(0, len(data), _PIECE):  # an error of the builder is raised after a piece
        parser.feed(data[begin:begin + _PIECE])
    root = parser.close()
    for element in root.iter():
        element.tag, element.tail = element.tag.rpartition('}')[2], None
    unit = _unit(root)
    elements, corners = Counter[str](), Counter[str]()
    for geometry in root.iterfind('library_geometries/geometry'):
        name = f'#{geometry.get("id")}'
        elements[name] += sum(1 for _ in geometry.iter())
        corners[name] += sum(map(_corners, geometry.iterfind('mesh')))
    _expand(root, elements, corners)
    root.set('xmlns', 'http://www.collada.org/2005/11/COLLADASchema')
    return ElementTree.tostring(root, 'utf-8'), unit


def _expand(root: Element, elements: Counter[str], corners: Counter[str]) -> None:
    """
    Replace instances of nodes by the nodes, and keep only what is used.

    :param elements: the number of elements of geometries, by URL, which count at each instance.
    """
    nodes = {f'#{node.get("id")}': node for node in root.iter('node')}
    root[:] = [child for child in root if child.tag in _LIBRARIES]
    waiting, all_elements, all_corners, size = [*root.iterfind('library_visual_scenes')], 0, 0, 0
    while waiting:
        parent = waiting.pop()
        for i, child in enumerate(parent):
            url = child.get('url', '')
            if child.tag == 'instance_node':
                if url not in nodes:
                    raise MeshError(f'it has no node {quoted(url)}, which an <instance_node> '
                                    'names: export it again')
                parent[i] = child = nodes[url]
            elif child.tag == 'instance_geometry':
                all_elements += elements[url]
                all_corners += corners[url]
            all_elements += 1
            size += sum(map(len, (child.text or '', *child.attrib.values())))
            waiting.append(child)
        if all_elements > _MAX_ELEMENTS or size > MAX_BYTES:
            _refuse_parts()
        check_size(0, all_corners)


class _Builder(ElementTree.TreeBuilder):
    def doctype(self, *_: object) -> None:
        raise MeshError(f'it {HAS_DOCTYPE}')


def _unit(root: Element) -> float:
    element = root.find('asset/unit')
    text = '1' if element is None else element.get('meter', '1')
    try:
        unit = float(text)
    except ValueError:
        unit = 0.0
    if not (isfinite(unit) and unit > 0.0):
        raise MeshError(f'its unit must be a positive number of metres, got {quoted(text)}: write '
                        '<unit meter="1"/>')
    return unit


def _corners(mesh: Element) -> int:
    """Return the number of corners of the polygons of a mesh, whose indices are checked."""
    lengths = {f'#{source.get("id")}': _length(source) for source in mesh.iterfind('source')}
    for vertices in mesh.iterfind('vertices'):
        lengths[f'#{vertices.get("id")}'] = min(
            (lengths.get(each.get('source', ''), 0) for each in vertices.iterfind('input')),
            default=0)
    corners = 0
    for primitive in mesh:
        if len(primitive.findall('input')) > _MAX_INPUTS:
            _refuse_parts()
        indices = [_numbers(each, np.int64) for each in primitive.iterfind('p')]
        if not indices:
            continue
        inputs = [(_natural(each.get('offset'), 'offset'), each.get('source', ''))
                  for each in primitive.iterfind('input')]
        columns = max((offset for offset, _ in inputs), default=0) + 1
        numbers = np.concatenate([each[:len(each) // columns * columns] for each in indices])
        size = len(numbers) // columns
        for offset, name in inputs:
            _check_range(numbers[offset::columns], 0, lengths.get(name, 0) - 1,
                         f'an index of {name}')
        for vcount in primitive.iterfind('vcount'):
            counts = _numbers(vcount, np.int64)
            _check_range(counts, 1, size, 'a number of vertices in <vcount>')
            _check_count(counts.sum(), size, 'vertices of polygons')
        if primitive.tag == 'triangles':
            _check_count(_natural(primitive.get('count', 0), 'count'), size // 3, 'triangles')
        corners += size
    return corners


def _length(source: Element) -> int:
    """Return the number of elements of a source, which pycollada reads by its <param>s."""
    array, accessor = source.find('float_array'), source.find('technique_common/accessor')
    if array is None or accessor is None:
        raise MeshError('a <source> of it has no <float_array> or no <accessor>: export it again')
    size, params = len(_numbers(array, np.float64)), len(accessor.findall('param'))
    stride = _natural(accessor.get('stride', params), 'stride')
    if not 0 < params <= _MAX_PARAMS or stride != params or size % params:
        raise MeshError(f'a <source> of it has {size} numbers, a stride of {stride} and {params} '
                        f'<param>s, of which 1 to {_MAX_PARAMS} are read: export it again')
    _check_count(_natural(array.get('count', 0), 'count'), size, 'numbers')
    _check_count(_natural(accessor.get('count', 0), 'count'), size // params, 'elements')
    return size // params


def _numbers(element: Element, dtype: type) -> NDArray[Any]:
    return np.fromstring(element.text or '', dtype, sep=' ')


def _check_range(numbers: NDArray[Any], least: int, most: int, what: str) -> None:
    for number in (numbers.min(), numbers.max()) if len(numbers) else ():
        if not least <= number <= most:
            raise MeshError(f'{what} must be from {least} to {most}, got {number}: export it '
                            'again')


# All formats


def _natural(value: Any, what: str) -> int:
    """Return an integer, or a text of one, that is not negative."""
    if isinstance(value, str) and value.strip().isdecimal() and len(value) < 20:
        value = int(value)
    if type(value) is not int or value < 0:
        raise MeshError(f'{what} must be an integer from 0 on, got {quoted(str(value))}: export '
                        'it again')
    return value


def _check_count(declared: int, most: int, what: str) -> None:
    if declared > most:
        raise MeshError(f'it declares {declared} {what}, but its data hold {most}: export it '
                        'again')


def _check_ply(data: bytes) -> None:
    """Refuse elements that an ASCII file does not have; trimesh compares those of binary files."""
    head, _, rest = data.partition(b'end_header')
    if b'ascii' in head:
        counts = re.findall(rb'^element\s+\S+\s+(\d+)', head, re.MULTILINE)
        _check_count(sum(map(int, counts)), rest.count(b'\n'), 'elements')


# glTF


def _glb(data: bytes) -> bytes:
    """Return a binary glTF whose nodes, meshes and accessors fit its data."""
    end = 20 + int.from_bytes(data[12:16], 'little')
    if end - 20 > _MAX_JSON:
        raise MeshError(f'its JSON has more than {_MAX_JSON // 10**6} MB: export it again')
    tree = json.loads(data[20:end])
    views, nodes = tree.get('bufferViews', []), tree.get('nodes', [])
    total = sum(_natural(view['byteLength'], 'byteLength') for view in views)
    counts, numbers = [], []
    for accessor in tree.get('accessors', []):
        count = _natural(accessor['count'], 'count')
        width = _NUMBERS[accessor['type']]
        size = width * _SIZES[accessor['componentType']]
        if 'bufferView' in accessor:
            _check_count(count, _held(accessor, size, views), 'elements')
        elif count > _MAX_WITHOUT_DATA:
            raise MeshError(f'it declares {count} elements without data, but at most '
                            f'{_MAX_WITHOUT_DATA} are allowed: export it again')
        total += count * size
        counts.append(count)
        numbers.append(count * width)
    if total > _MAX_ACCESSED:
        raise MeshError(f'its accessors have more than {_MAX_ACCESSED // 10**6} MB: simplify it')
    meshes = [mesh['primitives'] for mesh in tree.get('meshes', [])]
    check_size(0, sum(_most(each, counts, numbers) for mesh in meshes for each in mesh))
    _check_tree(nodes, tree.get('scenes', []))
    if sum(len(meshes[node['mesh']]) for node in nodes if 'mesh' in node) > _MAX_OBJECTS:
        _refuse_parts()
    for material in tree.get('materials', []):  # trimesh would compute with all their pixels
        gloss = material.get('extensions', {}).get('KHR_materials_pbrSpecularGlossiness', {})
        for name in [name for name in gloss if name.endswith('Texture')]:
            del gloss[name]
    text = json.dumps(tree).encode()
    text += b' ' * (-len(text) % 4)
    return (data[:8] + struct.pack('<II', 20 + len(text) + len(data[end:]), len(text))
            + data[16:20] + text + data[end:])


def _held(accessor: dict[str, Any], size: int, views: list[Any]) -> int:
    """Return how many elements of a size (bytes) the data of an accessor can hold."""
    view = views[_natural(accessor['bufferView'], 'bufferView')]
    _natural(view['buffer'], 'buffer')
    _natural(view.get('byteOffset', 0), 'byteOffset')
    stride = _natural(view.get('byteStride', size), 'byteStride')
    if stride < size:
        raise MeshError(f'its byteStride is {stride}, but an element has {size} bytes: export it '
                        'again')
    rest = view['byteLength'] - _natural(accessor.get('byteOffset', 0), 'byteOffset') - size
    return 0 if rest < 0 else 1 + rest // stride


def _most(primitive: dict[str, Any], counts: list[int], numbers: list[int]) -> int:
    """Return the largest number of elements of the accessors of a primitive."""
    sizes = [counts[_natural(index, name)] for name, index in primitive['attributes'].items()]
    if 'indices' in primitive:
        sizes.append(numbers[_natural(primitive['indices'], 'indices')])
    return max(sizes, default=0)


def _check_tree(nodes: list[Any], scenes: Iterable[Any]) -> None:
    """Refuse nodes that are not trees, as glTF says, or that are too deep."""
    children = [child for node in nodes for child in node.get('children', ())]
    if len(children) > len({*children}):
        raise MeshError('a node of it has several parents: export it again')
    level = {root for scene in scenes for root in scene.get('nodes', ())}
    for _ in range(_MAX_DEPTH):
        level = {child for index in level for child in nodes[index].get('children', ())}
    if level:
        raise MeshError(f'its nodes are in a circle, or more than {_MAX_DEPTH} deep: export it '
                        'again')
