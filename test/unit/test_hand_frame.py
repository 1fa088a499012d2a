"""The frame that a viewer places by hand, as a viewer of the page moves it, and its texts."""

from contextlib import closing, ExitStack
from html import unescape
from math import cos, pi, sin
from typing import cast

import pytest

from puretf import Transform, TransformBuffer
from puretf_tools.view.placement import FrameWatcher

pytest.importorskip('viser')
from viewer import Viewer
from websockets.exceptions import ConnectionClosed

from puretf_tools.view.details import command_line
from puretf_tools.view.feed import HandPublisher
from puretf_tools.view.hand_frame import HandFrame
from puretf_tools.view.server import serve
from puretf_tools.view.viser_private import HANDLES

T = 1_700_000_000 * 10**9
HALF = 0.5 ** 0.5
PARENT = HANDLES.rpartition('/')[0]
START = {'type': 'TransformControlsDragStartMessage', 'name': HANDLES, 'owner': ''}
END = {**START, 'type': 'TransformControlsDragEndMessage'}
DRAG = {**START, 'type': 'TransformControlsUpdateMessage', 'wxyz': [1, 0, 0, 0],
        'position': [0, 0, 0]}


class Page:
    """A page with the controls of the frame only, and a viewer of it."""

    def __init__(self, stack, can_publish=False):
        """Serve the page; `published` has what is sent, which is refused by `why`."""
        self.buffer, self.published, self.why, self.fixed = TransformBuffer(), [], '', ''
        self.stopped = []
        for parent, child, x in ('map', 'odom', 1.0), ('odom', 'base', 2.0), ('world', 'tree', 3):
            self.move(parent, child, x)
        self._watcher = FrameWatcher(self.buffer)
        self.server = stack.enter_context(serve('127.0.0.1'))
        self.hand = HandFrame(self.server.gui, self.server.scene,
                              cast(HandPublisher, self) if can_publish else None)
        self.update()
        self.viewer = stack.enter_context(closing(Viewer(self.server.get_port())))
        self.until(lambda: 'Publish' in {each.get('label') for each in self.viewer.gui.values()})

    def move(self, parent, child, x):
        """Insert a static frame, turned by 90 degrees about z."""
        self.buffer.insert(T, parent, child, (x, 0.0, 0.0, 0.0, 0.0, HALF, HALF), is_static=True)

    def send(self, transform, _):
        """Publish for the frame."""
        self.published.append(transform)
        return self.why

    def stop(self, name):
        """Stop publishing the frame."""
        self.stopped.append(name)

    def update(self):
        """Update as the page does."""
        placement = self._watcher.placement(self.fixed)
        self.hand.parent.set_options(placement.names)
        self.hand.update(placement)

    def until(self, condition):
        """Update until a condition holds."""
        self.viewer.until(condition, self.update)

    def text(self, key):
        """Return a text; '' if it is not shown."""
        found = self.viewer.text(key).partition(f'data-text="{key}"')[2].partition('>')[2]
        return unescape(found.partition('<')[0])


@pytest.fixture
def page():
    """A page where a frame 'hand' can be published."""
    with ExitStack() as stack:
        page = Page(stack, True)
        page.viewer.set('New frame', ' hand ')
        page.until(lambda: page.text('command'))
        yield page


def test_numbers_move_the_handles_and_handles_the_numbers(page):
    """The handles are in the parent; roll, pitch and yaw are about fixed axes."""
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
    for message in START, {**DRAG, 'position': [0.1234, -1, 0], 'wxyz': [
            cos(pi / 8), 0.0, 0.0, sin(pi / 8)]}, END:
        viewer.send(message)
    page.until(lambda: viewer.value('x, y, z (m)') == [0.123, -1, 0])
    page.until(lambda: viewer.value('RPY (°)') == [0, 0, 45])
    page.move('odom', 'base', 4.0)  # the handles stay in their parent
    page.until(lambda: viewer.nodes[PARENT]['position'] == pytest.approx([1, 4, 0]))
    assert viewer.value('x, y, z (m)') == [0.123, -1, 0]


def test_integers_of_a_browser(page):
    """A browser sends 0.0 as an int; the handles can be moved by less than 1 m afterwards."""
    viewer = page.viewer
    viewer.send({**DRAG, 'wxyz': [0, 0, 0, 1]})
    page.until(lambda: viewer.value('RPY (°)') == [0, 0, 180])
    for x in 0.5, 0:
        viewer.set('x, y, z (m)', [x, 0, 0])
        page.until(lambda x=x: viewer.nodes[HANDLES].get('position') == [x, 0, 0])


def test_wrong_numbers_of_a_viewer(page):
    """They are rounded; what is not three finite numbers ends the connection."""
    viewer, nan = page.viewer, float('nan')
    viewer.set('x, y, z (m)', [1, 2, 0.00049])
    page.until(lambda: viewer.value('x, y, z (m)') == [1, 2, 0])
    viewer.set('RPY (°)', [720, 0, 0])
    page.until(lambda: '--x 1.0 --y 2.0 --roll 12.566370614 --' in page.text('command'))
    for value in [nan, 0, 0], [4], [], [1, 2, 3, 4], ['x', 0, 0]:
        with closing(Viewer(page.server.get_port())) as bad:
            bad.until(lambda: 'Publish' in {each.get('label') for each in bad.gui.values()})
            bad.set('x, y, z (m)', value)
            with pytest.raises(ConnectionClosed):
                bad.until(lambda: False)


@pytest.mark.parametrize('message', [
    {**START, 'name': '/frames'}, {**DRAG, 'name': '/frames'}, {**END, 'name': PARENT},
    {**DRAG, 'position': [float('nan'), 0, 0]}, {**DRAG, 'position': [0, 0]},
    {**DRAG, 'position': ['x', 0, 0]},
    {**DRAG, 'wxyz': [0, 0, 0, 0]}, {**DRAG, 'wxyz': [float('inf'), 0, 0, 0]},
    {**DRAG, 'wxyz': [1, 0, 0, 0, 0]}, {**DRAG, 'wxyz': 1}])
def test_nonsense_ends_its_own_connection(page, message):
    """No other viewer receives it."""
    with closing(Viewer(page.server.get_port())) as bad:
        bad.send(message)
        with pytest.raises(ConnectionClosed):
            bad.until(lambda: False)
    page.viewer.set('x, y, z (m)', [1, 0, 0])
    page.until(lambda: page.viewer.nodes[HANDLES].get('position') == [1, 0, 0])


def test_it_is_published_while_publish_is_on(page):
    """It is off at first; each change is sent once; a new name switches it off."""
    viewer, published = page.viewer, page.published
    viewer.set('x, y, z (m)', [1, 0, 0])
    page.until(lambda: '--x 1.0' in page.text('command'))
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
    assert (len(published), page.stopped) == (2, ['hand'])


def test_the_parent_of_a_published_frame_stays(page):
    """A new fixed frame is not proposed any more."""
    page.fixed = 'odom'
    page.until(lambda: page.viewer.value('Parent') == 'odom')
    page.viewer.set('Publish', True)
    page.until(lambda: page.published)
    page.fixed = 'base'
    for _ in range(3):
        page.update()
    assert [each.frame_id for each in page.published] == ['odom']


def test_a_refusal_switches_publish_off(page):
    """The page says why until the name or the parent changes, and still shows the command."""
    page.why = '/other publishes frame hand already'
    page.viewer.set('Publish', True)
    page.until(lambda: page.text('hand') == f'not published: {page.why}')
    page.until(lambda: page.viewer.value('Publish') is False)
    assert page.text('command')
    page.viewer.set('Parent', 'base')
    page.until(lambda: not page.text('hand'))
    page.viewer.set('Parent', 'map')
    page.until(lambda: page.text('hand'))
    page.why = ''
    page.viewer.set('Publish', True)
    page.until(lambda: len(page.published) == 2)
    page.until(lambda: not page.text('hand'))


@pytest.mark.parametrize(('name', 'parent', 'problem'), [
    ('/hand', 'map', 'the name /hand begins with a slash'), ('base', 'base', 'its own parent'),
    ('map', 'base', 'frame map is above base: there would be a loop'),
    ('a\x1b[2J', 'map', 'must be printable'), ('a' * 1025, 'map', 'at most 1024 bytes'),
    ('hand', 'gone', 'the parent gone does not exist'), ('hand', '(none)', 'choose a parent')])
def test_frames_that_cannot_be_published(page, name, parent, problem):
    """The page says why, has no command to copy, and publishes nothing."""
    page.viewer.set('New frame', name)
    page.viewer.set('Parent', parent)
    page.until(lambda: problem in page.text('hand'))
    assert not page.text('command')
    page.viewer.set('Publish', True)
    page.until(lambda: 'not published' in page.text('hand'))
    assert not page.published


def test_a_page_without_a_name_has_no_handles():
    """Nor a command; without ROS, as for a bag, 'Publish' is hidden."""
    with ExitStack() as stack:
        page = Page(stack)
        page.until(lambda: page.viewer.nodes.get(HANDLES, {}).get('visible') is False)
        page.until(lambda: page.viewer.get('Publish', 'visible') is False)
        page.viewer.set('Publish', True)
        page.viewer.set('New frame', 'tree')
        page.until(lambda: page.text('hand') == 'the bag has a frame tree already')
        page.viewer.set('New frame', '<b>')
        page.until(lambda: "--child-frame-id '<b>'" in page.text('command'))


def test_the_texts_that_are_copied():
    """No number has an exponent."""
    transform = Transform(0, 'map', "it's: é", (1.0, 1e-6, -0.0), (0.0, 0.0, -HALF, HALF))
    numbers = zip(('x', 'y', 'z', 'roll', 'yaw'), (*transform.translation, 0.0, -pi / 2))
    assert command_line(transform.frame_id, transform.child_frame_id, numbers) == (
        'static_transform_publisher --x 1.0 --y 1e-06 --yaw -1.570796327 --frame-id map '
        """--child-frame-id 'it'"'"'s: é'""")
