"""Names in texts: which are similar, which are slips, and how they are printed."""

import pytest

from puretf._text.names import shortened
from puretf._text.similar_names import is_slip, near_names

#: Two names of one frame.
SLIPS = [
    ('base_link ', 'base_link'), (' odom', 'odom'), (' map ', 'map'), ('Base_Link', 'base_link'),
    ('/base_link', 'base_link'), ('laser-1', 'laser_1'), ('camera\u200b', 'camera'),
    ('Base-Link', 'base_link'), ('robot/base', 'robot_base'), ('base_lnk', 'base_link'),
    ('robot1/odem', 'robot1/odom'), ('tools', 'tool')]
#: Names that are different on purpose.
DIFFERENT = [
    ('left_wheel', 'right_wheel'), ('camera_1', 'camera_2'), ('joint_1', 'joint_2'),
    ('link_1_1', 'link_11'), ('map2', 'map'), ('wheel_fl', 'wheel_fr'), ('arm_x', 'arm_y'),
    ('x+', 'x-'), ('robot_a/base', 'robot_b/base'), ('tim/odom', 'tom/odom'), ('_', '-'),
    ('', ' '), ('map', 'odom'), ('rgb', 'imu'), ('map', 'map')]


@pytest.mark.parametrize(('name', 'other'), SLIPS)
def test_a_slip_is_told(name, other):
    """The order of the two names does not matter."""
    assert is_slip(name, other)
    assert is_slip(other, name)


@pytest.mark.parametrize(('name', 'other'), DIFFERENT)
def test_names_that_differ_on_purpose(name, other):
    """Other numbers, sides, short words and namespaces are no slips."""
    assert not is_slip(name, other)
    assert not is_slip(other, name)


@pytest.mark.parametrize(('name', 'nearest'), [
    ('BASE_LINK', 'base_link'), ('base_link ', 'base_link'), ('/odom', 'odom'),
    ('baselink', 'base_link'), ('BASE-LNIK', 'base_link'), ('joint1', 'joint_1')])
def test_case_blanks_and_signs_do_not_hide_the_nearest_name(name, nearest):
    """It is the first of those that an error lists."""
    known = ['base_laser', 'base_link', 'joint_2', 'joint_1', 'odom', 'map']
    assert near_names(name, known)[0] == nearest


@pytest.mark.parametrize(('name', 'printed'), [
    ('base_link ', "'base_link '"), (' map', "' map'"), ('base link', 'base link'),
    ('tool\t', r'tool\t'), ('odom\u00a0', r'odom\xa0'), ('', '')])
def test_a_blank_at_an_end_is_printed(name, printed):
    """Other white space is escaped, as each character that is not printable."""
    assert shortened(name) == printed
