"""Descriptions of robots: forward kinematics, shapes, what is refused."""

import re
import tracemalloc
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

from environment import DATA
from hypothesis import example, given
from hypothesis import strategies as st
from model import matrix
import numpy as np
import pytest
from transforms3d import affines, axangles, euler

from puretf import Transform
from puretf_tools.robot.description import Mimic, parse
from puretf_tools.robot.urdf_text import DescriptionError, MAX_SIZE, read

LIMIT = '<limit lower="-2" upper="1.5" effort="1" velocity="1"/>'


def link(name, content=''):
    """Return the text of a link."""
    return f'<link name="{name}">{content}</link>'


def joint(name, kind, parent, child, xyz='0 0 0', rpy='0 0 0', axis='1 0 0', more=''):
    """Return the text of a joint."""
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{more}{LIMIT}</joint>')


def robot(*parts, links=()):
    """Return the text of a robot, with links of the given names."""
    return f'<robot name="r">{"".join(map(link, links))}{"".join(parts)}</robot>'


def tree(*joints):
    """Return the text of a robot with the links of its joints."""
    names = dict.fromkeys(name for _, _, parent, child, *_ in joints for name in (parent, child))
    return robot(*(joint(*numbers) for numbers in joints), links=names)


ARM = tree(
    ('shoulder', 'revolute', 'base', 'upper', '0 0 0.5', '0 0 0', '0 0 1'),
    ('elbow', 'revolute', 'upper', 'lower', '0.4 0 0', '0 0 0', '0 1 0'))


def shift(*xyz):
    """Return the (4, 4) matrix of a translation."""
    return affines.compose(xyz, np.eye(3), np.ones(3))


def turn(axis, angle):
    """Return the (4, 4) matrix of a rotation about x, y or z."""
    return axangles.axangle2aff(np.eye(3)['xyz'.index(axis)], angle)


def oracle(text, positions):
    """Return the (4, 4) matrix of each child link in its parent, from the XML itself."""
    matrices = {}
    element: Any
    for element in ElementTree.fromstring(text).findall('joint'):
        xyz, rpy, axis = (np.array(element.find(tag).get(name).split(), np.float64)
                          for tag, name in (('origin', 'xyz'), ('origin', 'rpy'), ('axis', 'xyz')))
        axis = axis / np.linalg.norm(axis)
        in_parent = affines.compose(xyz, euler.euler2mat(*rpy), np.ones(3))
        position = positions[element.get('name')]
        if element.get('type') in ('revolute', 'continuous'):
            in_parent = in_parent @ axangles.axangle2aff(axis, position)
        elif element.get('type') == 'prismatic':
            in_parent = in_parent @ shift(*(axis * position))
        matrices[element.find('child').get('link')] = element.find('parent').get('link'), in_parent
    return matrices


def matrix_of(pose):
    """Return the (4, 4) matrix of a pose, whose quaternion must have length 1."""
    assert np.linalg.norm(pose[3:]) == pytest.approx(1, abs=1e-12)
    return matrix(pose[:3], pose[3:])


def in_root(matrices, name):
    """Return the (4, 4) matrix of a link in the root."""
    result = np.eye(4)
    while name in matrices:
        name, in_parent = matrices[name]
        result = in_parent @ result
    return result


angles = st.floats(-40, 40)
vectors = st.tuples(*[st.floats(-100, 100)] * 3)
axes = vectors.filter(lambda axis: np.linalg.norm(axis) > 1e-3) | st.just((1e-9, 1e-9, 0.0))
kinds = st.sampled_from(
    ['revolute', 'continuous', 'prismatic', 'fixed', 'planar', 'floating'])


@given(st.lists(st.tuples(st.integers(0, 9), kinds, vectors, st.tuples(*[angles] * 3), axes,
                          angles), min_size=1, max_size=10))
@example([(0, 'revolute', (0.0,) * 3, (0.0, 0.0, 3e-282), (0.0, 0.0, 1.0), 0.0)])
def test_forward_kinematics(joints):
    """The pose of each link in the root is that of an independent computation by matrices."""
    text = tree(*(
        (f'j{i}', kind, f'l{parent % (i + 1)}', f'l{i + 1}',
         *(' '.join(map(repr, vector)) for vector in vectors))
        for i, (parent, kind, *vectors, _) in enumerate(joints)))
    positions = {f'j{i}': position for i, (*_, position) in enumerate(joints)}
    description, expected = parse(text), oracle(text, positions)
    actual = {joint.child: (joint.parent, matrix_of(joint.pose_at(positions[joint.name])))
              for joint in description.joints}
    buffer = description.poses({
        joint.name: positions[joint.name] for joint in description.joints if joint.is_movable})
    for frame in description.links:
        np.testing.assert_allclose(in_root(actual, frame), in_root(expected, frame), atol=1e-9)
        np.testing.assert_allclose(buffer.lookup_transform('l0', frame).matrix(),
                                   in_root(expected, frame), atol=1e-9)


def test_poses_of_a_robot():
    """They hold at all times, also beyond limits; other joints are at 0."""
    description = parse(ARM)
    positions: Any = {'shoulder': np.float32(9.0), 'elbow': np.int64(2)}
    buffer = description.poses(positions)
    assert {*buffer.frame_names()} == {*description.links}
    expected = shift(0, 0, 0.5) @ turn('z', 9) @ shift(0.4, 0, 0) @ turn('y', 2)
    for time in 0, 1, -5, 2**62:
        found = buffer.lookup_transform('base', 'lower', time)
        np.testing.assert_allclose(found.matrix(), expected, atol=1e-12)
        assert found.stamp == time
    assert buffer.set_transform_static(Transform(0, 'base', 'upper', (1.0, 0.0, 0.0)))
    np.testing.assert_array_equal(buffer.lookup_transform('base', 'upper').matrix(),
                                  shift(1, 0, 0))
    for origin in description.poses(), description.poses({}):
        np.testing.assert_allclose(origin.lookup_transform('base', 'lower').matrix(),
                                   shift(0.4, 0, 0.5), atol=1e-12)
    assert parse(robot(links=['alone'])).poses().frame_names() == []


def test_poses_of_joints_that_follow_others():
    """Also through other mimics; a position of its own wins, as in robot_state_publisher."""
    description = parse(robot(*(
        joint(name, 'continuous', f'l{i}', f'l{i + 1}', axis='0 0 1', more=more)
        for i, (name, more) in enumerate((
            ('c', '<mimic joint="b" multiplier="-3" offset="1"/>'),
            ('b', '<mimic joint="a" multiplier="2" offset="0.5"/>'), ('a', '')))),
        links=[f'l{i}' for i in range(4)]))
    for positions, expected in (({'a': 0.25}, (-2, 1, 0.25)),
                                ({'a': 0.25, 'b': 0.1}, (0.7, 0.1, 0.25))):
        buffer = description.poses(positions)
        for i, angle in enumerate(expected):
            np.testing.assert_allclose(buffer.lookup_transform(f'l{i}', f'l{i + 1}').matrix(),
                                       turn('z', angle), atol=1e-12)


@pytest.mark.parametrize(('positions', 'error', 'text'), [
    ({'sholder': 1.0}, ValueError, "the robot has no joint 'sholder' that can move: correct the "
     "name, or leave it out. Nearest known: 'shoulder'."),
    ({'mount': 1.0}, ValueError, None),
    ({3: 1.0}, ValueError, "the robot has no joint '3' that can move: correct the name, or leave "
     "it out. Known joints: 'shoulder', 'elbow'."),
    ({'elbow': float('nan')}, ValueError, "the position of joint 'elbow' must be between -1e+09 "
     'and 1e+09 (rad or m), got nan'),
    ({'elbow': -np.inf}, ValueError, None),
    ({'elbow': 10**400}, ValueError, None),
    ({'elbow': '1.0'}, TypeError, "the position of joint 'elbow' must be a number (rad or m), "
     "got '1.0' of type str"),
    ({'elbow': None}, TypeError, None), ({'elbow': [1.0]}, TypeError, None),
    ([0.1, 0.2], TypeError, 'joint_positions must be a dict of names and positions, such as '
     "{'elbow': 0.5}, got [0.1, 0.2] of type list"),
    (None, TypeError, None)])
def test_positions_that_are_wrong(positions, error, text):
    """One line names the joint, and the nearest name; the remedies work."""
    description = parse(tree(
        ('shoulder', 'revolute', 'base', 'upper'), ('elbow', 'revolute', 'upper', 'lower'),
        ('mount', 'fixed', 'lower', 'tool')))
    with pytest.raises(error) as caught:
        description.poses(positions)
    assert re.fullmatch('.+', str(caught.value))
    assert text in (None, str(caught.value))
    description.poses({'shoulder': 1.0, 'elbow': 0.5})


@pytest.mark.parametrize('name', ['/', '/base', 'x' * 1025])
def test_links_that_cannot_be_frames(name):
    """The error names both, and the remedy works."""
    with pytest.raises(ValueError, match=r"^joint 'j': 'base' and .*: rename the links") as caught:
        parse(tree(('j', 'fixed', 'base', name))).poses()
    assert 'a name has 1 to 1024 bytes, and its leading slash does not count' in str(caught.value)
    assert parse(tree(('j', 'fixed', 'base', '/' + 'x' * 1024))).poses().frame_names() == [
        'x' * 1024, 'base']


def test_links_joints_and_root():
    """Names are in the order of the text; limits and mimic are read, or have defaults."""
    description = parse(robot(
        joint('a', 'revolute', 'x', 'base', more='<mimic joint="b" multiplier="-2"/>'),
        joint('b', 'continuous', 'world', 'x'), links=['base', 'world', 'x']))
    assert description.links == ('base', 'world', 'x')
    assert description.root == 'world'
    a, b = description.joints
    assert a.limits == (-2.0, 1.5)
    assert a.mimic == Mimic('b', -2.0, 0.0)
    assert (b.limits, b.mimic) == (None, None)
    assert all(joint.is_movable for joint in description.joints)


def test_shapes_and_their_colors():
    """Colors come from the robot, from the shape, or from an earlier link; textures are none."""
    description = parse(robot(
        link('a', '<visual><origin xyz="1 2 3"/><geometry><box size="1 2 3"/></geometry>'
                  '<material name="red"/></visual>'
                  '<visual><geometry><cylinder radius="0.1" length="2"/></geometry>'
                  '<material name="own"><color rgba="0 1 0 0.5"/></material></visual>'
                  '<collision><geometry><sphere radius="3"/></geometry></collision>'),
        link('b', '<visual><geometry><mesh filename="package://p/m.stl"/></geometry>'
                  '<material name="own"/></visual>'
                  '<visual><geometry><mesh filename="m.dae" scale="1 1 -2"/></geometry>'
                  '<material name="wood"><texture filename="wood.png"/></material></visual>'),
        joint('j', 'fixed', 'a', 'b'),
        '<material name="red"><color rgba="1 0 0 1"/></material>'))
    assert [(shape.link, shape.kind, shape.size, shape.file, shape.rgba)
            for shape in description.visuals] == [
        ('a', 'box', (1.0, 2.0, 3.0), '', (1.0, 0.0, 0.0, 1.0)),
        ('a', 'cylinder', (0.1, 2.0), '', (0.0, 1.0, 0.0, 0.5)),
        ('b', 'mesh', (1.0, 1.0, 1.0), 'package://p/m.stl', (0.0, 1.0, 0.0, 0.5)),
        ('b', 'mesh', (1.0, 1.0, -2.0), 'm.dae', None)]
    assert description.visuals[0].pose == (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
    assert [(shape.link, shape.kind, shape.size) for shape in description.collisions] == [
        ('a', 'sphere', (3.0,))]
    assert not description.warnings


@pytest.mark.parametrize(('geometry', 'reason'), [
    ('<torus/>', 'torus'), ('', '<geometry> must contain'),
    ('<box size="1 2"/>', "size of <box> must be three numbers .*, got '1 2'"),
    ('<box/>', 'size'), ('<cylinder radius="1"/>', 'length'), ('<sphere radius="nan"/>', "'nan'"),
    ('<mesh/>', 'filename')])
def test_a_broken_shape_is_left_out(geometry, reason):
    """The robot is accepted, with a warning that names the link."""
    description = parse(robot(link('tip', f'<visual><geometry>{geometry}</geometry></visual>')))
    assert not description.visuals
    warning, = description.warnings
    assert re.fullmatch(f"link 'tip': a visual is left out: .*{reason}.*", warning)


#: XML that makes short texts long, or reads files. Comments and instructions may stand before it.
DOCTYPES = {
    'entities': '<!DOCTYPE robot [<!ENTITY a "aaaaaaaaaa">' + ''.join(
        f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip('abcdefgh', 'bcdefghi')) + ']>',
    'default attributes': '<?xml version="1.0"?>\n<!DOCTYPE robot [<!ATTLIST link ' + ''.join(
        f'a{i} CDATA "{"x" * 100}" ' for i in range(100)) + '>]>',
    'external entity': '<!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]>',
    'external subset': '<!-- > --><?a <b?>\r\n<!DOCTYPE robot SYSTEM "http://localhost/robot.dtd">',
    'nothing inside': '\ufeff<?xml version="1.0" encoding="UTF-16"?><!---->\t<!DOCTYPE robot>',
    'not closed': '<!DOCTYPE robot [<!ATTLIST link a CDATA "x"',
}
BAD = {
    'empty': (' \n', "got ''; robot_state_publisher FILE takes a file"),
    'not XML': ('base_link', "must be the text of a URDF, which begins with <, got 'base_link'"),
    'path': ('/opt/robots/my robot.urdf', 'FILE takes a file, URDF or xacro$'),
    'HTML': ('<html><p>404</p></html>', 'must be <robot>, got <html>'),
    'SDF': ('<?xml version="1.0"?><sdf version="1.9"><model name="m"/></sdf>',
            'must be <robot>, got <sdf>, which is SDF'),
    'cut off': ('<robot name="r"><link', 'not valid XML: .*line 1'),
    'instruction not closed': (robot(link('a')) + '<?a', 'not valid XML: .*line 1'),
    'made of two comments': ('<!-<!-- -->- --><!DOCTYPE robot>' + robot(link('a')),
                             'not valid XML'),
    'NUL': ('<robot name="r\0"/>', 'not valid XML'),
    'surrogate': ('<robot name="\udcff"/>', 'not valid XML'),
    **{name: (f'{text}<robot name="r"><link name="a"/></robot>', 'has a <!DOCTYPE.*: remove it')
       for name, text in DOCTYPES.items()},
    '10 MB': (robot(link('base', ' ' * MAX_SIZE)), 'too long: at most 10000000 characters'),
    # An expression that tried each way to split the digits would take hours.
    'a million digits': (robot(link('base'), link('arm'), joint(
        'j', 'fixed', 'base', 'arm', xyz=f'{"1" * 10**6}x 0 0')),
        'xyz of <origin> must be three numbers'),
    'other element': ('<sdf/>', 'must be <robot>, got <sdf>'),
    'no name': ('<robot/>', 'the robot has no name'),
    'version': ('<robot name="r" version="2.0"/>', "must be 1.0, got '2.0'"),
    'no link': (robot(), 'the robot has no link'),
    'no root': (robot(joint('j', 'fixed', 'a', 'b'), joint('k', 'fixed', 'b', 'a'), links='ab'),
                'no root: .* loop'),
    'two roots': (robot(links=('left', 'right')), "2 roots, 'left', 'right': connect them"),
    'loop': (robot(joint('j', 'fixed', 'x', 'y'), joint('k', 'fixed', 'y', 'x'), links='axy'),
             "loop, .* not below the root 'a': 'x', 'y'"),
    'to itself': (robot(joint('j', 'fixed', 'a', 'a'), links='ab'), "'a' with itself"),
    'unknown parent': (robot(joint('j', 'fixed', 'z', 'a'), links='a'),
                       "joint 'j': the parent 'z' is not a link"),
    'unknown child': (robot(joint('j', 'fixed', 'a', 'z'), links='a'),
                      "joint 'j': the child 'z' is not a link"),
    'no parent': (tree(('j', 'fixed', 'a', 'b')).replace('<parent link="a"/>', '<parent/>'),
                  "joint 'j' has no parent"),
    'link twice': (robot(links='aa'), "two links have the name 'a'"),
    'joint twice': (robot(joint('j', 'fixed', 'a', 'b'), joint('j', 'fixed', 'b', 'c'),
                          links='abc'), "two joints have the name 'j'"),
    'material twice': ((DATA / 'robots' / 'two_materials.urdf').read_text(),
                       "two materials have the name 'blue'"),  # as by urdfdom 4.0.1
    'type': (tree(('j', 'ball', 'a', 'b')), "joint 'j': the type must be .*, got 'ball'"),
    'no limit': (tree(('j', 'revolute', 'a', 'b')).replace(LIMIT, ''),
                 "joint 'j' has no limit: a revolute joint needs <limit lower"),
    'limit without effort': (tree(('j', 'revolute', 'a', 'b')).replace('effort="1"', ''),
                             "joint 'j': <limit> has no effort: write effort="),
    'zero axis': (tree(('j', 'revolute', 'a', 'b', '0 0 0', '0 0 0', '0 0 0')),
                  "joint 'j': the axis must have a finite length"),
    'endless axis': (tree(('j', 'revolute', 'a', 'b', '0 0 0', '0 0 0', '1.7e308 1.7e308 0')),
                     "joint 'j': the axis must have a finite length"),
    'two numbers': (tree(('j', 'fixed', 'a', 'b', '1 2')),
                    "joint 'j': xyz of <origin> must be three numbers .*, got '1 2'"),
    'xacro': (tree(('j', 'fixed', 'a', 'b', '${x} 0 0')), r'it is xacro: put it into a file'),
    'name with newlines': (tree(('j\n\x85k', 'ball', 'a', 'b')), 'the type must be'),
}


#: By a case of BAD: what its remedy makes of the text, or what stands in place of what.
MENDED: dict[str, Any] = {
    'entities': lambda text: text[text.index(']>') + 2:],
    'external subset': lambda text: re.sub('<!DOCTYPE.*?>', '', text),
    'no link': ('</robot>', '<link name="..."/></robot>'),
    'two roots': ('</robot>', joint('j', 'fixed', 'left', 'right') + '</robot>'),
    'unknown parent': ('</robot>', '<link name="z"/></robot>'),
    'link twice': ('<link name="a"></link>', joint('j', 'fixed', 'b', 'a') + '<link name="b"/>'),
    'no limit': ('</joint>', '<limit lower="0" upper="1" effort="1" velocity="1"/></joint>'),
    'zero axis': ('<axis xyz="0 0 0"/>', '<axis xyz="0 0 1"/>'),
    'two numbers': ('"1 2"', '"1 2 3"'), 'type': ('ball', 'planar'),
    'to itself': ('child link="a"', 'child link="b"'),
    'material twice': ('"blue"', '"red"'), 'joint twice': ('joint name="j"', 'joint name="k"')}


@pytest.mark.parametrize('name', MENDED)
def test_the_remedy_of_an_error_works(name):
    """What the error says is done."""
    text, change = BAD[name][0], MENDED[name]
    mended = change(text) if callable(change) else text.replace(*change, 1)
    assert mended != text
    assert parse(mended).root


@pytest.mark.parametrize('text', [
    '<!-- <!DOCTYPE robot> --><?a <!DOCTYPE b>?>' + robot(link('a')),
    robot(link('a', '<!-- <!DOCTYPE robot [<!ENTITY a "b">]> -->')),
    robot(link('a', '<![CDATA[<!DOCTYPE robot>]]>')), robot(link('a')) + '<!-- <!DOCTYPE -->',
    robot(link('a')).replace('name="r"', 'name="&lt;!DOCTYPE>"')])
def test_the_word_alone_is_no_document_type(text):
    """In a comment, an instruction, CDATA or an attribute, it does nothing."""
    assert parse(text).links == ('a',)


def test_a_document_type_is_refused_before_a_parser_sees_it(monkeypatch):
    """Expat would go on to the end of the text."""
    monkeypatch.setattr(expat, 'ParserCreate', None)
    with pytest.raises(DescriptionError, match='has a <!DOCTYPE'):
        parse(DOCTYPES['entities'] + robot(link('a')))


def test_a_long_namespace_is_not_repeated():
    """Expat would put it into the name of each kind of element."""
    text = robot(link('a'), *(f'<x{i}/>' for i in range(100))).replace(
        '<robot', f'<robot xmlns="{"n" * 10**6}"')
    tracemalloc.start()
    try:
        assert parse(text).links == ('a',)
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


def test_shapes_are_bounded_also_if_none_is_valid():
    """So are the warnings about them."""
    found = parse(robot(link('a', '<visual/>' * 2010)))
    assert len(found.warnings) == 2001
    assert found.warnings[-1] == 'only the first 2000 shapes are read'


def test_the_first_child_of_a_geometry_is_the_shape():
    """As in urdfdom 4.0.1; a warning names the other one."""
    description = parse(read(DATA / 'robots' / 'geometry_two.urdf'))
    assert [(shape.kind, shape.pose[:3]) for shape in description.visuals] == [
        ('box', (0.0, 0.0, 0.0)), ('mesh', (0.0, 0.0, 0.0))]
    assert description.warnings == (
        "link 'a': <geometry> has more than <box>: <origin> is ignored",
        "link 'a': <geometry> has more than <mesh>: <material> is ignored")


@pytest.mark.parametrize(('material', 'warning'), [
    ('<material name="m"><color rgba="217 38 25 1"/></material>', "material 'm' has no color: "),
    ('<material name="m"><color rgba="1 0 0"/></material>', "material 'm' has no color: "),
    ('<material name="none"/>', "material 'none' has no color: rgba must be four numbers"),
    ('<material name="blue"/>', ''), ('', ''), ('<material name="skin"/>', ''),
    ('<material name="m"><texture filename="a.png"/></material>', '')])
def test_colors_that_are_ignored_are_named(material, warning):
    """The shape is drawn all the same."""
    text = robot('<material name="blue"><color rgba="0 0 1 1"/></material>'
                 '<material name="skin"><texture filename="skin.png"/></material>', link(
        'base', f'<visual><geometry><sphere radius="1"/></geometry>{material}</visual>'))
    found = parse(text)
    assert len(found.visuals) == 1
    assert [warning in each for each in found.warnings] == [True] * bool(warning)


def test_an_empty_name_is_a_name_where_urdfdom_takes_it():
    """Of a joint to mimic, and of a file; but not of a link in a joint."""
    found = parse(robot(
        link('a', '<visual><geometry><mesh filename=""/></geometry></visual>'), link('b'),
        joint('j', 'revolute', 'a', 'b', more='<mimic joint=""/>')))
    assert found.joints[0].mimic == Mimic('', 1.0, 0.0)
    assert found.visuals[0].file == ''
    with pytest.raises(DescriptionError, match="joint 'j': the child '' is not a link"):
        parse(robot(joint('j', 'fixed', 'a', ''), links=['a', '']))


def test_a_mimic_of_an_unknown_joint_is_named():
    """The joint moves by itself."""
    text = robot(joint('j', 'revolute', 'a', 'b', more='<mimic joint="k"/>'), links='ab')
    assert parse(text).warnings == (
        "joint 'j' mimics 'k', which is not a joint of the robot: correct the name. "
        "Known joints: 'j'.",)


def test_a_long_file_with_long_characters(tmp_path):
    """Its characters count, not its bytes."""
    text = robot(link('base', f'<!-- {"ö" * (MAX_SIZE // 2 + 1)} -->'))
    (tmp_path / 'robot.urdf').write_text(text, encoding='utf-8')
    assert read(tmp_path / 'robot.urdf') == text


@pytest.mark.parametrize('name', BAD)
def test_bad_input_is_one_clear_error(name):
    """The error names the offender and is one printable line."""
    text, message = BAD[name]
    with pytest.raises(DescriptionError, match=message) as caught:
        parse(text)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400


@given(st.text(max_size=40), st.integers(0, 400), st.integers(0, 40))
def test_any_text_is_parsed_or_refused(insertion, begin, length):
    """No text makes another error than DescriptionError."""
    text, message = ARM, ''
    try:
        parse(text[:begin] + insertion + text[begin + length:])
    except DescriptionError as error:
        message = str(error)
    assert message.isprintable()


@pytest.mark.parametrize('change', [
    lambda text: (DATA / 'robots' / 'leading_newline.urdf').read_text(),
    lambda text: f' \t\n<?xml version="1.0" encoding="UTF-16"?>{text}',
    lambda text: f'<!-- a -- b --->{text}<!---->',
    lambda text: text.replace('<link', '<gazebo:plugin gazebo:a="1"/><link'),
    lambda text: text.replace('<robot', '<robot xmlns="http://example.org"')])
def test_xml_that_tinyxml2_takes(change):
    """So does urdfdom 4.0.1, which parses by it."""
    description = parse(change(robot(link('a'))))
    assert description.links == ('a',)
    assert not description.warnings


def test_the_line_of_an_error_is_that_of_the_text():
    """Although comments are removed before it is parsed."""
    with pytest.raises(DescriptionError, match='mismatched tag: line 6, column 2'):
        parse('\n<?xml version="1.0"?>\n<!-- a\n-- b -->\n<robot name="r"><link name="a">\n'
              '</robot>')


def test_of_two_parents_the_last_one_counts():
    """As in urdfdom, the joints are sorted by name."""
    description = parse(robot(joint('k', 'fixed', 'b', 'c'), joint('j', 'fixed', 'a', 'c'),
                              joint('l', 'fixed', 'a', 'b'), links='abc'))
    assert [joint.name for joint in description.joints] == ['k', 'l']
    assert description.warnings == ("the link 'c' has two parents: joint 'j' is ignored",)


@pytest.mark.parametrize(('name', 'content', 'message'), [
    ('missing.xacro', None, 'No such file'), ('r.urdf', b'\xff', 'not text in UTF-8'),
    ('r.urdf', b'', 'it is empty'), ('r.xacro', b'<robot', 'xacro cannot expand')])
def test_bad_files_are_one_clear_error(tmp_path, name, content, message):
    """The error names the file."""
    if name.endswith('.xacro'):
        pytest.importorskip('xacro')
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(DescriptionError, match=message) as caught:
        read(tmp_path / name)
    assert str(caught.value).isprintable()
    assert name in str(caught.value)


def test_a_text_in_place_of_its_file():
    """The error is short, and says what to write."""
    with pytest.raises(DescriptionError, match='this is the text of a file; write') as caught:
        read(10 * ARM)
    assert len(str(caught.value)) < 400
