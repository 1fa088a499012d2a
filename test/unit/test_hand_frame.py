"""The frame that a viewer places by hand, as a viewer of the page moves it, and its texts."""

from contextlib import ExitStack
from html import unescape
from math import cos, pi, sin

import pytest

from puretf import Transform, TransformBuffer

pytest.importorskip('viser')
from viewer import Page, StubFeed

from puretf_tools.view.feed import BagFeed
from puretf_tools.view.viser_private import HANDLES

T = 1_700_000_000 * 10**9
HALF = 0.5 ** 0.5
PARENT = HANDLES.rpartition('/')[0]
START = {'type': 'TransformControlsDragStartMessage', 'name': HANDLES}
END = {**START, 'type': 'TransformControlsDragEndMessage'}
DRAG = {**START, 'type': 'TransformControlsUpdateMessage', 'wxyz': [1, 0, 0, 0],
        'position': [0, 0, 0]}


def text(shown, key):
    """Return a text; '' if it is not shown."""
    found = shown.viewer.text(key).partition(f'data-text="{key}"')[2].partition('>')[2]
    return unescape(found.partition('<')[0])


def move(buffer, parent, child, x):
    """Insert a static frame, turned by 90 degrees about z."""
    buffer.insert(T, parent, child, (x, 0.0, 0.0, 0.0, 0.0, HALF, HALF), is_static=True)


@pytest.fixture
def buffer():
    """A buffer with two trees."""
    buffer = TransformBuffer()
    for parent, child, x in ('map', 'odom', 1.0), ('odom', 'base', 2.0), ('world', 'tree', 3):
        move(buffer, parent, child, x)
    return buffer


@pytest.fixture
def page(buffer):
    """A page where a frame 'hand' can be published."""
    with ExitStack() as stack:
        shown = Page(StubFeed(buffer), [1000.0], stack)
        shown.viewer.set('New frame', ' hand ')
        shown.until(lambda: text(shown, 'command'))
        yield shown


def test_numbers_move_the_handles_and_handles_the_numbers(page):
    """In the parent, about fixed axes; numbers are rounded to 1 mm and 0.01 degrees."""
    viewer = page.viewer
    viewer.set('Parent', 'base')
    viewer.set('x, y, z (m)', [1, 2.5, 0])
    viewer.set('RPY (°)', [90, 0, 90])
    page.until(lambda: viewer.nodes[HANDLES].get('wxyz') == pytest.approx([0.5] * 4))
    assert viewer.nodes[HANDLES]['position'] == [1, 2.5, 0]
    assert viewer.nodes[HANDLES]['visible']
    page.until(lambda: viewer.nodes[PARENT].get('position') == pytest.approx([1, 2, 0]))
    page.until(lambda: viewer.nodes[PARENT].get('wxyz') == pytest.approx(
        [0, 0, 0, 1], abs=1e-9))
    owner = {'owner': viewer.nodes[HANDLES]['owner']}
    for message in START, {**DRAG, 'position': [0.1234, -1, 0], 'wxyz': [
            cos(pi / 8), 0.0, 0.0, sin(pi / 8)]}, END:
        viewer.send({**message, **owner})
    page.until(lambda: viewer.value('x, y, z (m)') == [0.123, -1, 0])
    page.until(lambda: viewer.value('RPY (°)') == [0, 0, 45])
    move(page.feed.buffer, 'odom', 'base', 4.0)  # the handles stay in their parent
    page.until(lambda: viewer.nodes[PARENT]['position'] == pytest.approx([1, 4, 0]))
    assert viewer.value('x, y, z (m)') == [0.123, -1, 0]
    viewer.set('x, y, z (m)', [1, 2, 0.00049])
    viewer.set('RPY (°)', [720.001, 0, 0])
    page.until(lambda: '--x 1.0 --y 2.0 --roll 12.566370614 --' in text(page, 'command'))


def test_integers_of_a_browser(page):
    """A browser sends 0.0 as an int; the handles can be moved by less than 1 m afterwards."""
    viewer = page.viewer
    viewer.send({**DRAG, 'wxyz': [0, 0, 0, 1], 'owner': viewer.nodes[HANDLES]['owner']})
    page.until(lambda: viewer.value('RPY (°)') == [0, 0, 180])
    for x in 0.5, 0:
        viewer.set('x, y, z (m)', [x, 0, 0])
        page.until(lambda x=x: viewer.nodes[HANDLES].get('position') == [x, 0, 0])


def test_it_is_published_while_publish_is_on(page):
    """It is off at first; each change is sent once; a new name switches it off."""
    viewer, published = page.viewer, page.feed.sent
    viewer.set('x, y, z (m)', [1, 0, 0])
    page.until(lambda: '--x 1.0' in text(page, 'command'))
    assert not published
    assert viewer.value('Publish') is False
    viewer.set('Publish', True)
    page.until(lambda: published)
    viewer.set('RPY (°)', [0, 0, 180])
    page.until(lambda: len(published) == 2)
    for _ in range(3):
        page.update()
    assert published[0] == Transform(0, 'map', 'hand', (1, 0, 0), (0, 0, 0, 1))
    assert published[1].rotation == pytest.approx((0, 0, 1, 0))
    viewer.set('New frame', 'hand2')
    page.until(lambda: viewer.get('Publish', 'value') is False)
    assert (len(published), page.feed.stopped) == (2, ['hand'])


def test_the_parent_of_a_published_frame_stays(page):
    """A new fixed frame is not proposed any more."""
    page.set('Fixed frame', 'odom')
    page.until(lambda: page.viewer.value('Parent') == 'odom')
    page.viewer.set('Publish', True)
    page.until(lambda: page.feed.sent)
    page.set('Fixed frame', 'base')
    page.until(lambda: page.viewer.detail('fixed') == 'base')
    assert [each.frame_id for each in page.feed.sent] == ['odom']


def test_a_refusal_switches_publish_off(page):
    """The page says why until the name or the parent changes, and still shows the command."""
    page.feed.why = '/other publishes frame hand already'
    page.viewer.set('Publish', True)
    page.until(lambda: text(page, 'hand') == f'not published: {page.feed.why}')
    page.until(lambda: page.viewer.value('Publish') is False)
    assert text(page, 'command')
    page.viewer.set('Parent', 'base')
    page.until(lambda: not text(page, 'hand'))
    page.viewer.set('Parent', 'map')
    page.until(lambda: text(page, 'hand'))
    page.feed.why = ''
    page.viewer.set('Publish', True)
    page.until(lambda: len(page.feed.sent) == 2)
    page.until(lambda: not text(page, 'hand'))


@pytest.mark.parametrize(('name', 'parent', 'problem'), [
    ('/hand', 'map', 'the name /hand begins with a slash'),
    ('base', 'base', 'frame base is above base, or the same: there would be a loop'),
    ('map', 'base', 'frame map is above base, or the same: there would be a loop'),
    ('a\x1b[2J', 'map', 'must be printable'), ('hand', 'a\0', 'must be printable'),
    ('a' * 1025, 'map', 'at most 1024 bytes'),
    ('hand', 'gone', 'the parent gone does not exist'), ('hand', '(none)', 'choose a parent')])
def test_frames_that_cannot_be_published(page, name, parent, problem):
    """The page says why, has no command to copy, and publishes nothing."""
    page.viewer.set('New frame', name)
    page.viewer.set('Parent', parent)
    page.until(lambda: problem in text(page, 'hand'))
    page.until(lambda: page.viewer.nodes[HANDLES]['visible'] == (parent in ('map', 'base')))
    assert not text(page, 'command')
    page.viewer.set('Publish', True)
    page.until(lambda: 'not published' in text(page, 'hand'))
    assert not page.feed.sent


def test_a_page_without_a_name_has_no_handles(buffer):
    """Nor a command; without ROS, as for a bag, 'Publish' is hidden."""
    with ExitStack() as stack:
        page = Page(BagFeed(buffer, 'bag'), [1000.0], stack)
        page.until(lambda: page.viewer.nodes.get(HANDLES, {}).get('visible') is False)
        page.until(lambda: page.viewer.get('Publish', 'visible') is False)
        page.viewer.set('Publish', True)
        page.viewer.set('New frame', 'tree')
        page.until(lambda: text(page, 'hand') == 'the bag has a frame tree already')
        page.viewer.set('New frame', '<b>')
        page.until(lambda: "--child-frame-id '<b>'" in text(page, 'command'))
