"""Names in texts: which are similar, which are slips, and how they are printed."""

import pytest

from puretf import ConnectivityException, TransformBuffer
from puretf._text.names import shortened
from puretf._text.similar_names import is_slip, near_names

STILL = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
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


def error_of_two_trees(*edges, target, source):
    """Return the text of the error of a lookup between two trees."""
    buffer = TransformBuffer()
    for parent, child in edges:
        buffer.insert(0, parent, child, STILL, is_static=True)
    with pytest.raises(ConnectivityException) as raised:
        buffer.lookup_transform(target, source)
    return str(raised.value)


@pytest.mark.parametrize(('name', 'other'), [
    slip for slip in SLIPS if not slip[0].startswith('/')])  # tf2 removes the slash
@pytest.mark.parametrize('ends', [('top', 'tip'), ('tip', 'top')])
def test_two_trees_because_of_a_slip(name, other, ends):
    """The error names both; the frames of the lookup may be others."""
    target, source = ends
    text = error_of_two_trees(
        ('top', name), (other, 'arm'), ('arm', 'tip'), target=target, source=source)
    assert any(f'{a!r} and {b!r} are almost the same name' in text
               for a, b in ((name, other), (other, name)))
    assert '. If they are one frame, use one name. More: ' in text


@pytest.mark.parametrize('edges', [
    *([('top', name), (other, 'tip')] for name, other in DIFFERENT
      if name and other not in ('', 'map')),
    pytest.param([('top ', 'top'), ('map', 'tip')], id='within one tree'),
    pytest.param([('base', 'top'), ('map', 'tip'), ('earth', 'base ')], id='in a third tree')],
    ids=str)
def test_two_trees_for_another_reason(edges):
    """Names are different on purpose, or a slip does not separate the two trees."""
    text = error_of_two_trees(*edges, target='top', source='tip')
    assert 'almost the same' not in text
    assert ' in the tree with root ' in text
