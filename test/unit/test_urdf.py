"""The description of the arm: its frames, joints and limits are those of arm.py."""

from itertools import pairwise
from xml.etree import ElementTree

from environment import ROOT
import numpy as np
import pytest

from dummy_arm.arm import Arm

PATH = ROOT / 'dummy_arm' / 'urdf' / 'dummy_arm.urdf'


@pytest.fixture(scope='module')
def robot():
    """The root of the XML."""
    return ElementTree.parse(PATH).getroot()


def numbers(joint, tag, attribute, default='0 0 0'):
    """Return the numbers in an attribute of a tag of a joint."""
    element = joint.find(tag)
    return np.array((default if element is None else element.get(attribute, default)).split(),
                    float)


def poses(robot, angles):
    """Return the pose of each joint's child in its parent, x, y, z and quaternion x, y, z, w."""
    found = []
    for joint, angle in zip(robot.iterfind('joint'), [*angles, 0.0], strict=True):
        assert not numbers(joint, 'origin', 'rpy').any()
        axis = numbers(joint, 'axis', 'xyz', '1 0 0')
        found.append([*numbers(joint, 'origin', 'xyz'), *np.sin(angle / 2) * axis,
                      np.cos(angle / 2)])
    return np.array(found)


def test_the_chain_is_that_of_the_frames(robot):
    """Each frame is a link; a moving joint has the name of its child."""
    frames = Arm().frames
    assert tuple(link.get('name') for link in robot.iterfind('link')) == frames
    joints = [*robot.iterfind('joint')]
    assert [(joint.find('parent').get('link'), joint.find('child').get('link'))
            for joint in joints] == [*pairwise(frames)]
    assert [joint.get('name') for joint in joints] == [*frames[1:-1], 'tool']
    assert [joint.get('type') for joint in joints] == ['revolute'] * 3 + ['fixed']


def test_the_limits_are_those_of_the_joints(robot):
    """They are the same in both directions."""
    assert [(float(limit.get('lower')), float(limit.get('upper')))
            for limit in robot.iterfind('joint/limit')] == [
                (-joint.limit, joint.limit) for joint in Arm().joints]


def test_the_links_are_where_the_frames_are(robot):
    """Origins and axes result in the poses of arm.py, at any angles."""
    for angles in np.random.default_rng(1).uniform(-3, 3, (20, 3)):
        np.testing.assert_allclose(poses(robot, angles), Arm().poses_at(angles), atol=1e-15)


def test_every_link_can_be_seen_and_hit(robot):
    """Each has shapes to draw, whose materials are defined, and a shape for collisions."""
    materials = {material.get('name') for material in robot.iterfind('material')}
    for link in robot.iterfind('link'):
        assert {material.get('name') for material in link.iterfind('visual/material')} <= materials
        for tag in 'visual', 'collision':
            shapes = link.findall(f'{tag}/geometry/*')
            assert shapes
            assert {shape.tag for shape in shapes} <= {'box', 'cylinder', 'sphere'}


def test_it_can_be_a_parameter_on_a_command_line():
    """ROS reads the value of a parameter as YAML, in which ': ' and ' #' would end a text."""
    yaml = pytest.importorskip('yaml')
    assert yaml.safe_load(PATH.read_text()).split() == PATH.read_text().split()
