"""The bodies of robots in the page, as a viewer gets them, and the meshes that are loaded."""

from contextlib import ExitStack
import json
import os
from pathlib import Path
import shutil
import struct
import subprocess
import sys

from environment import DATA
import numpy as np
import pytest

from puretf import TransformBuffer

pytest.importorskip('viser')
from viewer import CLICK, Page, recorded, Viewer

from puretf_tools.commands.web_view import main
from puretf_tools.robot.observed import parsed, prefix
from puretf_tools.robot.shapes import MOST_SHAPES
from puretf_tools.view.export import Animation
from puretf_tools.view.feed import BagFeed
from puretf_tools.view.meshes import load, MAX_BYTES, MeshError, Meshes

S = 10**9
T = 1_700_000_000 * S
HALF = 0.5 ** 0.5
TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def link(name, *shapes, kind='visual'):
    """Return a link; shapes: geometry, and optionally attributes of its origin and a color."""
    parts = ''.join(
        f'<{kind}><origin {origin}/><geometry>{geometry}</geometry>'
        + f'<material name=""><color rgba="{rgba}"/></material>' * bool(rgba) + f'</{kind}>'
        for geometry, origin, rgba in ((*shape, '', '')[:3] for shape in shapes))
    return f'<link name="{name}">{parts}</link>'


def robot(*links, name='robot'):
    """Parse a robot whose links, without the first one, are children of the first one."""
    names = [each.split('"')[1] for each in links]
    joints = ''.join(
        f'<joint name="to {child}" type="fixed"><parent link="{names[0]}"/>'
        f'<child link="{child}"/></joint>' for child in names[1:])
    return parsed(f'<robot name="{name}">{"".join(links)}{joints}</robot>')


def spheres(*names):
    """Return a robot whose links are spheres."""
    return robot(*(link(name, ('<sphere radius="1"/>',)) for name in names))


def buffer_of(*edges, x=1.0):
    """Return a buffer with static frames, each x m before its parent."""
    buffer = TransformBuffer(10**18)
    for edge in edges:
        parent, child = edge.split(' ')
        buffer.insert(T, parent, child, (x, 0.0, 0.0, 0.0, 0.0, HALF, HALF), is_static=True)
    return buffer


def stl(*triangles):
    """Return triangles as a binary STL file."""
    return bytes(80) + struct.pack('<I', len(triangles)) + b''.join(
        struct.pack('<12fH', 0, 0, 1, *np.ravel(triangle), 0) for triangle in triangles)


def glb(text, numbers=b''):
    """Return a binary glTF of two chunks; the specification of glTF 2.0 shows its layout."""
    text += -len(text) % 4 * b' '
    return (struct.pack('<4sIII4s', b'glTF', 2, 28 + len(text) + len(numbers), len(text), b'JSON')
            + text + struct.pack('<I4s', len(numbers), b'BIN\0') + numbers)


def triangle_glb(position, times=1, **others):
    """Return the glTF of a triangle, several times, with this accessor of its vertices."""
    tree = {
        'asset': {'version': '2.0'}, 'scenes': [{'nodes': [0]}], 'nodes': [{'mesh': 0}],
        'meshes': [{'primitives': [{'attributes': {'POSITION': 0}, 'indices': 1}]}],
        'accessors': [position, {
            'bufferView': 1, 'componentType': 5125, 'count': 3 * times, 'type': 'SCALAR'}],
        'bufferViews': [{'buffer': 0, 'byteLength': 36},
                        {'buffer': 0, 'byteOffset': 36, 'byteLength': 12 * times}],
        'buffers': [{'byteLength': 36 + 12 * times}], **others}
    return glb(json.dumps(tree).encode(), struct.pack('<9f', *np.ravel(TRIANGLE))
               + struct.pack('<3I', 0, 1, 2) * times)


INSTANCE = '<instance_geometry url="#g"/>'


def dae(unit='1', libraries='', scene=INSTANCE):
    """Return the COLLADA of a triangle; `scene` is the contents of its node."""
    return (
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>'
        f'<unit meter="{unit}"/></asset>{libraries}<library_geometries><geometry id="g"><mesh>'
        '<source id="s"><float_array id="a" count="9">0 0 0 1 0 0 0 1 0</float_array>'
        '<technique_common><accessor source="#a" count="3" stride="3"><param name="X"/>'
        '<param name="Y"/><param name="Z"/></accessor></technique_common></source>'
        '<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>'
        '<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p>'
        '</triangles></mesh></geometry></library_geometries><library_visual_scenes>'
        f'<visual_scene id="sc"><node id="n">{scene}</node></visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#sc"/></scene></COLLADA>')


@pytest.fixture
def page():
    """A function that creates the page of one or more robots with some shapes, and a viewer."""
    with ExitStack() as stack:
        def create(buffer, robots, meshes=(), shapes=0):
            feed = BagFeed(buffer, 'bag')
            feed.robots = robots if isinstance(robots, dict) else {'/robot_description': robots}
            page = Page(feed, [1000.0], stack, meshes)
            if shapes:
                page.until(lambda: len(drawn(page)) == shapes)
            return page

        yield create


def parts(shown):
    """Return the nodes that move with links, each with its shapes."""
    nodes = shown.viewer.nodes
    return {name: [nodes[each] for each in nodes if each.startswith(f'{name}/')]
            for name in nodes if name.startswith('/world/robots/') and name.count('/') == 3}


def drawn(shown):
    """Return the shapes that are drawn."""
    return [shape for name, shapes in parts(shown).items()
            if shown.viewer.nodes[name].get('visible') for shape in shapes]


def says(shown, text):
    """Wait until the page says something about the robots."""
    shown.until(lambda: text in shown.viewer.text('robot'))


def test_the_shapes_of_a_link(page):
    """Each has its size, color and pose in the link; the link moves with its frame."""
    body = robot(link('base'), link(
        'a/b', ('<box size="1 2 3"/>', 'xyz="4 5 6"', '1 0.5 0 1'),
        ('<cylinder radius="0.5" length="2"/>', 'rpy="1.5707963267948966 0 0"', '0 0 1 0.5'),
        ('<sphere radius="0.25"/>',)))
    shown = page(buffer_of('map base', 'base a/b'), body, shapes=3)
    box, cylinder, sphere = drawn(shown)
    assert [*box['dimensions']] == [1, 2, 3]
    assert [*box['position']] == [4, 5, 6]
    assert [*box['color']] == [255, pytest.approx(127, abs=1), 0]
    assert box['opacity'] is None
    assert (cylinder['radius'], cylinder['height'], cylinder['opacity']) == (0.5, 2.0, 0.5)
    assert cylinder['wxyz'] == pytest.approx([HALF, HALF, 0, 0])
    assert sphere['radius'] == 0.25
    (name,) = parts(shown)
    node = shown.viewer.nodes[name]
    # Two turns of 90 degrees about z.
    assert [*node['position']] == pytest.approx([1, 1, 0])
    assert [*node['wxyz']] == pytest.approx([0, 0, 0, 1])
    says(shown, 'robot on /robot_description: 2 of 2 links have a frame')


def test_a_body_moves(page):
    """Only what has changed is sent."""
    buffer = TransformBuffer()
    buffer.insert(T, 'map', 'base', (1.0, 0, 0, 0, 0, 0, 1), is_static=True)
    buffer.insert(T, 'base', 'arm', (1.0, 0, 0, 0, 0, 0, 1))
    buffer.insert(T + 9 * S, 'base', 'arm', (10.0, 0, 0, 0, 0, 0, 1))
    body = spheres('base', 'arm')
    shown = page(buffer, body, shapes=2)
    base, arm = (shown.viewer.nodes[name] for name in parts(shown))
    base.pop('position')
    shown.act('pause')
    shown.act('seek', '9')
    shown.until(lambda: arm['position'][0] > 10.9)
    assert 'position' not in base


def test_collision_shapes_and_opacity(page):
    """They are off at first, in one color; the slider makes all shapes translucent."""
    box = '<box size="1 1 1"/>'
    body = robot(link('base', (box, '', '1 0 0 0.5')),
                 link('arm', (box, '', '1 0 0 1'), kind='collision'))
    shown = page(buffer_of('map base', 'base arm'), body)
    shown.until(lambda: len(drawn(shown)) == 1 and shown.viewer.text('robot'))
    shown.set('Collision', True)
    shown.until(lambda: len(drawn(shown)) == 2)
    visual, collision = drawn(shown)
    assert [*collision['color']] != [255, 0, 0]
    translucent = collision['opacity']
    assert 0.0 < translucent < 1.0
    shown.set('Opacity', 0.5)
    shown.until(lambda: visual['opacity'] == 0.25 and collision['opacity'] == translucent / 2)
    shown.set('Visual', False)
    shown.until(lambda: drawn(shown) == [collision])
    shown.set('Opacity', 1.0)
    shown.until(lambda: visual['opacity'] == 0.5)
    shown.set('Visual', True)
    shown.until(lambda: len(drawn(shown)) == 2)


def test_a_link_is_drawn_where_its_frame_is(page):
    """It is not drawn if its frame is too old, or not there; it is if this is only hidden."""
    buffer = buffer_of('map base')
    buffer.insert(T, 'base', 'arm', (1.0, 0, 0, 0, 0, 0, 1))
    buffer.insert(T + 60 * S, 'base', 'other', (1.0, 0, 0, 0, 0, 0, 1))
    body = spheres('base', 'arm', 'lost')
    shown = page(buffer, body, shapes=2)
    says(shown, '2 of 3 links have a frame')
    shown.set('Include', '-base')
    shown.until(lambda: 'base' not in shown.viewer.names())
    assert len(drawn(shown)) == 2
    shown.act('seek', '20')
    shown.until(lambda: len(drawn(shown)) == 1)
    shown.set('Frame timeout (s)', 60)
    shown.until(lambda: len(drawn(shown)) == 2)


def test_a_click_on_a_body_selects_the_frame(page):
    """As a click on the axes does."""
    body = spheres('base', 'arm')
    shown = page(buffer_of('map r/base', 'r/base r/arm'), {'/r/robot_description': body}, shapes=2)
    shown.until(lambda: shown.viewer.detail('parent') == 'r/base')
    base, _ = parts(shown)
    shown.viewer.send({**CLICK, 'name': f'{base}/0', 'instance_index': None,
                       'owner': shown.viewer.nodes[f'{base}/0']['owner']})
    shown.until(lambda: shown.viewer.detail('parent') == 'map')


@pytest.mark.parametrize(('topic', 'frames', 'expected'), [
    ('/robot_description', 'map base arm', ('', 2)),
    ('/robot_description', 'map r1base r1arm', ('r1', 2)),
    ('/robot_description', 'x/y/base x/y/arm', ('x/y/', 2)),
    ('/r1/robot_description', 'base arm', ('', 2)),
    ('/r1/robot_description', 'base arm r1/base r1/arm', ('r1/', 2)),
    ('/r1/robot_description', 'r1/base r2/base r2/arm', ('r1/', 1)),
    ('/a/b/robot_description', 'a/b/arm', ('a/b/', 1)),
    ('/r1/robot_description', 'r2/base r2/arm', ('r2/', 2)),
    ('/left/robot_description', 'base arm left_base left_arm', ('left_', 2)),
    ('/robot_description', 'map', ('', 0))])
def test_the_prefix_of_the_frames(topic, frames, expected):
    """It is that with which most links are found; that of the namespace comes first."""
    assert prefix(topic, 'base', ['base', 'arm'], {*frames.split()}) == expected


def test_descriptions_change(page):
    """A new one replaces the old one; a refused one is a line; without any, there is no tab."""
    shown = page(buffer_of('map base', 'base arm'), {})
    shown.until(lambda: '3 frames' in shown.viewer.shown().get('status', ()))

    assert not shown.viewer.text('robot')
    sphere = ('<sphere radius="1"/>',)
    shown.feed.robots = {'/robot_description': robot(link('base', sphere))}
    shown.until(lambda: len(drawn(shown)) == 1 and shown.viewer.text('robot'))
    before = {*parts(shown)}
    shown.feed.robots = {
        '/robot_description': robot(link('arm', sphere, sphere), name='&lt;new&gt;')}
    shown.until(lambda: len(drawn(shown)) == 2)
    assert before.isdisjoint(parts(shown))
    says(shown, '&lt;new&gt; on /robot_description')
    shown.feed.robots = {'/robot_description': parsed('<robot name="a"/>')}
    shown.until(lambda: not parts(shown))
    says(shown, '/robot_description: the robot has no link')


def test_odd_sizes_are_drawn(page):
    """A browser gets no number that would be infinite in float32, and not too many shapes."""
    body = robot(link('base', *[('<box size="1e300 -1 0"/>', 'xyz="1e300 0 0"')] * (
        MOST_SHAPES + 1)))
    shown = page(buffer_of('map base'), body, shapes=MOST_SHAPES)
    assert np.isfinite(np.array([*drawn(shown)[0]['dimensions'], *drawn(shown)[0]['position']],
                                np.float32)).all()
    says(shown, f'only the first {MOST_SHAPES} shapes are read')


def test_a_mesh(page, tmp_path):
    """It has the scale and the color of the description."""
    (tmp_path / 'pkg').mkdir()
    (tmp_path / 'pkg' / 'a b.STL').write_bytes(stl(TRIANGLE))
    body = robot(link('base', ('<mesh filename="package://pkg/a%20b.STL" scale="1 -2 3"/>', '',
                               '0 1 0 1')))
    shown = page(buffer_of('map base'), body, [str(tmp_path)], shapes=1)
    (mesh,) = drawn(shown)
    assert sorted(mesh['vertices'].reshape(-1, 3).tolist()) == sorted(TRIANGLE)
    assert mesh['faces'].size == 3
    assert [*mesh['scale']] == [1, -2, 3]
    shown.until(lambda: not any(  # the process that has loaded it has ended
        path.read_text() for path in Path('/proc/self/task').glob('*/children')))
    assert [*mesh['color']] == [0, 255, 0]


def test_large_meshes_come_last(page, tmp_path, monkeypatch):
    """One at a time, so that frames are not late; meanwhile the page says how many are there."""
    from puretf_tools.view.body import Body
    monkeypatch.setattr(Body, 'at_a_time', 50_000)  # bytes; a triangle has 48
    sizes = 5000, 2000, 3000, 1
    for size in sizes:
        corners = np.arange(9.0 * size).reshape(size, 3, 3)
        (tmp_path / f'{size}.stl').write_bytes(stl(*corners))
    shown, said = page(buffer_of('map base'), robot(link('base', *(
        (f'<mesh filename="{size}.stl"/>',) for size in sizes))), [str(tmp_path)]), set()

    def update():
        shown.clock[0] += 1.0
        shown.update()
        said.update(shown.viewer.shown()['status'])

    shown.viewer.until(lambda: len(drawn(shown)) == 4 and not any(
        'meshes' in text for text in shown.viewer.shown()['status']), update)
    (shapes,) = parts(shown).values()
    assert [shape['faces'].size // 3 for shape in shapes] == sorted(sizes)
    assert {f'meshes to come: {number}' for number in (1, 2, 3)} <= said


def test_missing_meshes(page, tmp_path, monkeypatch):
    """Each is a grey box of 0.1 m, and a line that says what to do."""
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    body = robot(link('base', ('<mesh filename="package://pkg/a.stl" scale="9 9 9"/>',),
                      ('<mesh filename="http://localhost/&lt;a&gt;.stl"/>',)),
                 link('arm', ('<sphere radius="1"/>',)))
    shown = page(buffer_of('map base', 'base arm'), body, [str(tmp_path)], shapes=3)
    boxes = [shape for shape in drawn(shown) if 'dimensions' in shape]
    for box in boxes:
        assert [*box['dimensions']] == [0.1] * 3
        assert len({*box['color']}) == 1
    says(shown, f'link base: package://pkg/a.stl: there is no such file below {tmp_path}: pass '
         '--meshes DIR, where DIR has the package or the file<br>')
    says(shown, 'link base: http://localhost/&lt;a&gt;.stl: only package://PACKAGE/PATH, '
         'file:///PATH and relative paths are read<')


@pytest.mark.parametrize(('count', 'most'), [(5, 2000), (80, 8300)])
def test_bytes_of_an_update(page, count, most):
    """
    At 30 updates a second, an arm takes at most 60 kB/s, and a robot of 80 links 250 kB/s.

    This includes a trail, and texts at each update.
    """
    buffer = TransformBuffer(10**18)
    for step in range(250):
        for i in range(count):
            half = 0.3 * np.sin(0.1 * step + i)
            buffer.insert(T + step * S // 30, 'map' if not i else f'link_{i - 1}', f'link_{i}',
                          (0.1, 0.05 * np.sin(0.1 * step) * (not i), 0.2, 0.0, 0.0,
                           np.sin(half), np.cos(half)))
    boxes = robot(*(link(f'link_{i}', ('<box size="1 2 3"/>',)) for i in range(count)))
    shown = page(buffer, boxes, shapes=count)
    shown.act('pause')
    sizes = []
    for step in range(230, 250):
        shown.feed.player.seek(T + step * S // 30)
        before = shown.viewer.size
        shown.step()
        sizes.append(shown.viewer.size - before)
    assert len(shown.viewer.trail()) > 150
    assert count * 50 < np.median(sizes[5:]) < most


def test_many_missing_meshes(page, tmp_path, monkeypatch):
    """There is a line for each, which is folded, until the page is loaded again."""
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    body = robot(*(link(name, *((f'<mesh filename="package://{package}/{name}_{i}.stl"/>',)
                                for package in ('left', 'right') for i in range(20)))
                   for name in ('base', 'arm')))
    shown = page(buffer_of('map base', 'base arm'), body, [str(tmp_path)], shapes=80)
    says(shown, f'left/base_0.stl: there is no such file below {tmp_path}: ')
    says(shown, '<br>and 50 more lines</details>')  # after all were looked for
    for package in 'left', 'right':
        (tmp_path / package).mkdir()
        for name in 'base', 'arm':
            for i in range(20):
                (tmp_path / package / f'{name}_{i}.stl').write_bytes(stl(TRIANGLE))
    viewer = Viewer(shown.server.get_port())  # the page is loaded again
    viewer.until(lambda: sum('vertices' in node for node in viewer.nodes.values()) == 80,
                 shown.update)
    assert 'not drawn' not in viewer.text('robot')
    viewer.close()


FOUND = 'inside'
FILES = {
    'package://pkg/a.stl': FOUND, 'package://pkg//b/../a.stl': FOUND,
    'package://pkg%2F%61.stl': FOUND, 'file://{outside}/../inside/pkg/a.stl': FOUND,
    'package://pkg/link.stl': FOUND,  # it belongs to the user
    'package://../outside/secret.stl': 'not below',
    'package://pkg/%2e%2e/%2E%2E/outside/secret.stl': 'not below',
    'package://': 'not below', 'file:///etc/passwd': 'not below',
    'file://{inside}/../outside/secret.stl': 'not below',
    'file://{inside}x/secret.stl': 'not below', 'file://{inside}': 'not below',
    'package://pkg': 'no such file', 'package://pkg/%252e%252e/a.stl': 'no such file',
    'package://pkg/fifo.stl': 'no such file',
    'package://{outside}/secret.stl': 'are read', 'package://%2Fetc/passwd': 'are read',
    'file://localhost{inside}/pkg/a.stl': 'are read', 'file://pkg/a.stl': 'are read',
    'file:{inside}/pkg/a.stl': 'are read', '{inside}/pkg/a.stl': 'are read',
    './pkg/%61.stl': FOUND, 'x/../../../pkg/a.stl': FOUND, 'a.stl': 'no such file',
    'pkg/../../outside/secret.stl': 'no such file',
    'http://127.0.0.1/a.stl': 'are read', 'data:,x': 'are read', '': 'are read',
    'FILE://{inside}/pkg/a.stl': 'are read', 'package://pkg/a.stl%00': 'are read',
    r'package://pkg\..\..\outside\secret.stl': 'no such file', '//etc/passwd': 'are read',
    'model://pkg/a.stl': 'are read', f'package://pkg/{"a" * 5000}.stl': 'no such file'}


@pytest.mark.parametrize('file', FILES, ids=lambda file: file[:60])
def test_only_files_below_the_search_path_are_read(tmp_path, monkeypatch, file):
    """The check is lexical, after percent escapes and '..'."""
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    inside, outside = tmp_path / 'inside', tmp_path / 'outside'
    (inside / 'pkg').mkdir(parents=True)
    outside.mkdir()
    for path in inside / 'pkg' / 'a.stl', outside / 'secret.stl':
        path.write_bytes(stl(TRIANGLE))
    (inside / 'pkg' / 'link.stl').symlink_to(outside / 'secret.stl')
    os.mkfifo(inside / 'pkg' / 'fifo.stl')
    meshes = Meshes([str(inside)])
    name = file.format(inside=inside, outside=outside)
    if FILES[file] == FOUND:
        assert inside in meshes.find(name).parents
    else:
        with pytest.raises(MeshError, match=FILES[file]):
            meshes.find(name)


def test_the_search_path(tmp_path, monkeypatch):
    """The directories come in their order, then the packages of a ROS environment."""
    for name in 'one/pkg', 'two/pkg', 'ros/share/pkg':
        (tmp_path / name).mkdir(parents=True)
    for name in 'two/pkg/a.stl', 'two/pkg/b.stl', 'one/pkg/b.stl', 'ros/share/pkg/c.stl':
        (tmp_path / name).write_bytes(b'')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path}/none:{tmp_path}/ros:')
    monkeypatch.chdir(tmp_path)
    meshes = Meshes(['one', 'two/'])
    assert meshes.find('package://pkg/a.stl') == tmp_path / 'two/pkg/a.stl'
    assert meshes.find('package://pkg/b.stl') == tmp_path / 'one/pkg/b.stl'
    assert meshes.find('package://pkg/c.stl') == tmp_path / 'ros/share/pkg/c.stl'
    monkeypatch.delenv('AMENT_PREFIX_PATH')
    with pytest.raises(MeshError, match='no directory to search'):
        Meshes().find('package://pkg/a.stl')


def test_a_mesh_of_several_parts(tmp_path):
    """Their poses are those of the file; a single color is kept."""
    import trimesh
    box = trimesh.creation.box((2, 2, 2))
    box.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 51, 255]))
    scene = trimesh.Scene()
    for x in 0, 10:
        scene.add_geometry(box.copy(), transform=trimesh.transformations.translation_matrix(
            [x, 0, 0]))
    scene.export(tmp_path / 'boxes.glb')
    mesh = load(tmp_path / 'boxes.glb')
    assert mesh.faces.shape == (24, 3)
    assert mesh.vertices.min(axis=0).tolist() == [-1, -1, -1]
    assert mesh.vertices.max(axis=0).tolist() == [11, 1, 1]
    assert mesh.rgba == (1.0, 0.0, 0.2, 1.0)


def test_a_robot_of_too_many_triangles(page, tmp_path, monkeypatch):
    """The meshes beyond the limit are grey boxes."""
    from puretf_tools.view import body as body_module
    monkeypatch.setattr(body_module, 'MAX_TRIANGLES', 1)
    (tmp_path / 'a.stl').write_bytes(stl(TRIANGLE))
    body = robot(link('base', *[(f'<mesh filename="file://{tmp_path}/a.stl"/>',)] * 2))
    shown = page(buffer_of('map base'), body, [str(tmp_path)], shapes=2)
    assert sum('dimensions' in shape for shape in drawn(shown)) == 1
    says(shown, 'more than 1 triangles')


def test_a_mesh_reads_no_other_file(tmp_path):
    """The materials and textures that it names are not opened."""
    (tmp_path / 'a.obj').write_text('mtllib a.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\n'
                                    'f 1 2 3\n')
    os.mkfifo(tmp_path / 'a.mtl')  # who opened it would wait for ever
    assert load(tmp_path / 'a.obj').rgba is None


def test_a_collada_mesh_has_its_own_unit():
    """The triangle is 100 mm large; assimp 5.2.5, which rviz2 uses, gives 0.1 m, too."""
    mesh = load(DATA / 'robots' / 'triangle_mm.dae')
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [0.1, 0.1, 0.0], rtol=1e-6)


@pytest.mark.parametrize('unit', ['', '<unit/>', '<unit name="meter"/>', '<unit meter="1"/>'])
def test_the_unit_of_collada_is_the_metre(tmp_path, unit):
    """COLLADA 1.4.1 says so, and the up axis is ignored."""
    text = (DATA / 'robots' / 'triangle_mm.dae').read_text()
    (tmp_path / 'a.dae').write_text(text.replace(
        '<unit name="millimeter" meter="0.001"/>', unit).replace('Z_UP', 'X_UP'))
    assert load(tmp_path / 'a.dae').vertices.max(axis=0).tolist() == [100, 100, 0]


def test_a_mesh_that_takes_too_much(tmp_path):
    """Time or memory: its process ends, and the next mesh is loaded by another one."""
    nodes = ''.join(f'<node id="d{i + 1}">{2 * f"""<instance_node url="#d{i}"/>"""}</node>'
                    for i in range(30))
    (tmp_path / 'a.dae').write_text(dae(
        libraries=f'<library_nodes><node id="d0">{INSTANCE}</node>{nodes}</library_nodes>',
        scene='<instance_node url="#d30"/>'))
    (tmp_path / 'a.glb').write_bytes(triangle_glb(
        {'componentType': 5126, 'count': 60_000_000, 'type': 'MAT4'}))
    (tmp_path / 'a.stl').write_bytes(stl(TRIANGLE))
    for name, limit in ('a.dae', '2 s'), ('a.glb', '2 GB'):
        with pytest.raises(MeshError, match=f'^it takes more than {limit}: simplify it'):
            load(tmp_path / name, 2)
        assert len(load(tmp_path / 'a.stl').faces) == 1


def test_a_mesh_of_too_many_triangles(tmp_path):
    """A small file can name the same part a thousand times."""
    (tmp_path / 'a.glb').write_bytes(triangle_glb(
        {'bufferView': 0, 'componentType': 5126, 'count': 3, 'type': 'VEC3'}, 2001,
        nodes=[{'mesh': 0}] * 1000, scenes=[{'nodes': [*range(1000)]}]))
    with pytest.raises(MeshError, match='more than 2000000 triangles'):
        load(tmp_path / 'a.glb')


def test_without_pycollada_a_collada_mesh_names_it(tmp_path):
    """The extra `view` brings it; on a desktop, it may be missing."""
    (tmp_path / 'collada.py').write_text('raise ImportError')
    code = ('import sys\nfrom pathlib import Path\n'
            'from puretf_tools.view.meshes import load, MeshError\n'
            'try:\n    load(Path(sys.argv[1]))\nexcept MeshError as error:\n    print(error)\n')
    done = subprocess.run([sys.executable, '-c', code, DATA / 'robots' / 'triangle_mm.dae'],
                          text=True, timeout=60, capture_output=True, check=True, env={
        **os.environ, 'PYTHONPATH': os.pathsep.join([str(tmp_path), *filter(None, sys.path)])})
    assert done.stdout == (
        '.dae files need pycollada: pip install pycollada, or convert it to .stl\n')


def test_a_mesh_that_is_too_large(tmp_path, monkeypatch):
    """It is refused before it is read to the end."""
    with (tmp_path / 'a.stl').open('wb') as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(MeshError, match='more than 50 MB'):
        load(tmp_path / 'a.stl')


PLY = b"""ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face %i
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 %i
"""
#: Files that are refused, and why.
BROKEN = [
    ('a.stl', b'', 'no triangles'), ('a.stl', b'solid x\nendsolid x\n', 'no triangles'),
    ('a.stl', stl([[float('nan')] * 3] * 3), 'not finite'),
    ('a.obj', b'f 1 2 3\n', 'cannot be loaded|no triangles'),
    ('a.glb', b'glTF', 'cannot be loaded'), ('a.ply', b'ply\n', 'cannot be loaded|no triangles'),
    ('a.xyz', b'0 0 0', r"the format '\.xyz' is not read: convert it to one of \.stl"),
    ('a', b'', 'the format'), ('a.dae', b'<COLLADA', 'cannot be loaded'),
    *(('a.dae', dae(unit=unit).encode(), '^its unit must be a positive number of metres, got '
       f'{unit!r}: write <unit meter=') for unit in ('0', '-1', 'nan', 'inf', '', 'mm')),
    ('a.dae', dae().replace('0 1 2', '0 1 3').encode(), 'cannot be loaded|no triangles'),
    ('a.ply', PLY % (1, -2), 'a triangle of it has the vertices -2 to 1, but there are 0 to 2'),
    ('a.ply', PLY % (1, 3), 'a triangle of it has the vertices 0 to 3, but there are 0 to 2')]


@pytest.mark.parametrize(('name', 'content', 'why'), BROKEN, ids=range(len(BROKEN)))
def test_a_mesh_that_is_refused(tmp_path, name, content, why):
    """The error says why, in one line."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(MeshError, match=why) as error:
        load(tmp_path / name)
    assert '\n' not in str(error.value)


def test_a_page_that_is_exported_has_all_shapes(tmp_path):
    """Also if a single moment is recorded."""
    feed = BagFeed(buffer_of('map base'), 'bag')
    feed.robots = {'/robot_description': robot(link('base', *[('<sphere radius="1"/>',)] * 150))}
    animation = Animation(feed)
    animation.add(0.0, T)
    names = [message.get('name', '') for _, message in recorded(animation.as_html())['messages']]
    assert len({name for name in names if name.startswith('/world/robots/0/')}) == 150


def test_an_export_says_which_meshes_are_missing(bags, tmp_path, monkeypatch, capsys):
    """On stderr, with the remedies."""
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    (tmp_path / 'pkg').mkdir()
    shutil.copy(DATA / 'robots' / 'lfs_pointer.stl', tmp_path / 'pkg')
    names = ['package://pkg/lfs_pointer.stl', *(f'meshes/{i}.stl' for i in range(12))]
    text = ''.join(f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
                   for name in names)
    bag = bags.make(tmp_path / 'bag', 'mcap', [*bags.walk(1), (
        '/robot_description', 100 * S, bags.string(
            f'<robot name="r"><link name="odom">{text}</link></robot>'), bags.STRING)])
    page = tmp_path / 'page.html'
    assert main(['--bag', str(bag), '--export', str(page), '--time', '0.1',
                 '--meshes', str(tmp_path)]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if 'not drawn' in line]
    assert lines[0] == (f'web_view: not drawn: link odom: {names[0]}: '
                        f'{tmp_path}/pkg/lfs_pointer.stl is a Git LFS pointer: git lfs pull')
    assert lines[1] == (
        f'web_view: not drawn: link odom: meshes/0.stl: there is no such file below {tmp_path}: '
        'pass --meshes DIR, where DIR has the package or the file')
    assert len(lines) == 13
