"""The description of the arm: its frames, joints and limits are those of arm.py."""

from itertools import pairwise
from xml.etree import ElementTree

from environment import ROOT
from model import matrix
import numpy as np
import pytest

from dummy_arm.arm import poses
from dummy_arm.grading.sheet import FRAMES, JOINTS
from puretf_tools.robot.description import parse

PATH = ROOT / 'dummy_arm' / 'urdf' / 'dummy_arm.urdf'


@pytest.fixture(scope='module')
def robot():
    """The description."""
    return parse(PATH.read_text())


def test_the_chain_is_that_of_the_frames(robot):
    """Each frame is a link; a moving joint has the name of its child."""
    assert robot.links == FRAMES[1:]
    assert [(joint.parent, joint.child) for joint in robot.joints] == [*pairwise(FRAMES[1:])]
    assert [joint.name for joint in robot.joints] == [*FRAMES[2:-1], 'tool']
    assert [joint.kind for joint in robot.joints] == ['revolute'] * 3 + ['fixed']


def test_the_limits_are_those_of_the_joints(robot):
    """They are the same in both directions."""
    assert [joint.limits for joint in robot.joints[:3]] == [
        (-joint.limit, joint.limit) for joint in JOINTS]


def test_the_links_are_where_the_frames_are(robot):
    """Origins and axes result in the poses of arm.py, at any angles."""
    for angles in np.random.default_rng(1).uniform(-3, 3, (20, 3)):
        ours, theirs = poses(angles), [
            joint.pose_at(angle) for joint, angle in zip(robot.joints, [*angles, 0.0])]
        for pose, other in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(matrix(pose[:3], pose[3:]), matrix(other[:3], other[3:]),
                                       atol=1e-14)


def test_every_link_can_be_seen_and_hit():
    """Each has shapes to draw, whose materials are defined, and a shape for collisions."""
    robot = ElementTree.parse(PATH).getroot()
    materials = {material.get('name') for material in robot.iterfind('material')}
    for link in robot.iterfind('link'):
        assert {material.get('name') for material in link.iterfind('visual/material')} <= materials
        for tag in 'visual', 'collision':
            shapes = link.findall(f'{tag}/geometry/*')
            assert shapes
            assert {shape.tag for shape in shapes} <= {'box', 'cylinder', 'sphere'}


def test_links_can_be_told_apart():
    """rviz2 draws all shapes of a link in the colour of the first one, on (48, 48, 48)."""
    robot = ElementTree.parse(PATH).getroot()
    colours = [next(link.iterfind('visual/material')).get('name')
               for link in robot.iterfind('link')]
    assert 'dark' not in colours
    assert all(first != second for first, second in pairwise(colours))


def test_it_can_be_a_parameter_on_a_command_line():
    """ROS reads the value of a parameter as YAML, in which ': ' and ' #' would end a text."""
    yaml = pytest.importorskip('yaml')
    assert yaml.safe_load(PATH.read_text()).split() == PATH.read_text().split()
