"""What web_view shows: placements, axes, trails, texts, and the page as a viewer gets it."""

from html import unescape
from itertools import pairwise
import json
import re

import numpy as np
import pytest

from puretf import TransformBuffer
from puretf_tools.view.axes_and_trail import axes, Display, lines, trail
from puretf_tools.view.feed import BagFeed
from puretf_tools.view.placement import FrameWatcher

S = 10**9
T = 1_700_000_000 * S
HALF = 0.5 ** 0.5


def pose(x, y=0.0, z=0.0, rotation=(0.0, 0.0, 0.0, 1.0)):
    """Return a pose."""
    return x, y, z, *rotation


def arm(buffer, stamp, *names):
    """Insert a chain of frames, each 1 m along x from the one before it."""
    for parent, child in pairwise(names):
        buffer.insert(stamp, parent, child, pose(1.0))


def moving(step):
    """Return a buffer in which base moves by 1 m along x in each of ten steps (ns)."""
    buffer = TransformBuffer(10**18)
    for i in range(11):
        buffer.insert(T + i * step, 'map', 'base', pose(i))
    return buffer


def chain(*names):
    """Return a buffer with a chain of frames."""
    buffer = TransformBuffer()
    arm(buffer, T, *names)
    return buffer


def test_what_is_shown():
    """All trees are shown, others beside that of the fixed frame, also what is below a loop."""
    buffer = TransformBuffer()
    placement = FrameWatcher(buffer).placement()
    assert (placement.fixed, placement.deepest) == ('', '')
    assert (len(placement.names), placement.poses.shape, placement.ages.shape) == (0, (0, 7), (0,))
    for tree in 'world tree', 'map odom base', 'map other', 'x y x', 'y below':
        arm(buffer, T, *tree.split())
    placement = FrameWatcher(buffer).placement()
    assert placement.fixed == 'map'
    assert placement.names == ['map', 'odom', 'other', 'base', 'world', 'tree', 'y', 'below']
    assert placement.parents == [-1, 0, 0, 1, -1, 4, -1, 6]
    assert placement.points.tolist() == [
        [0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0], [0, -2, 0], [1, -2, 0], [0, -4, 0],
        [1, -4, 0]]
    assert placement.poses[:, :3].tolist() == [
        [0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0]]
    assert placement.deepest == 'base'
    assert placement.trees == {'map': 0.0, 'world': -2.0, 'y': -4.0}
    assert [sorted(loop) for loop in placement.loops] == [['x', 'y']]
    assert placement.anchors[-1] == 'y'
    placement = FrameWatcher(buffer).placement('odom')
    assert dict(zip(placement.names, placement.points[:, 0])) == {
        'odom': 0, 'map': -1, 'base': 1, 'other': 0, 'world': 0, 'tree': 1, 'y': 0, 'below': 1}
    assert placement.deepest == 'base'  # the same as before: ties are not broken by chance
    assert FrameWatcher(buffer).placement('nowhere').fixed == 'map'
    assert FrameWatcher(buffer).placement('below').fixed == 'below'


@pytest.mark.parametrize(('trees', 'fixed'), [
    (['base_lnk laser tip', 'base_link hand'], 'base_link'),
    (['base_lnk laser tip', 'base_link hand', 'world tree'], 'world'),
    (['world tree', 'odom base_link'], 'odom'), (['earth odom', 'odom map'], 'map'),
    (['b c', 'a d'], 'a'), (['a d', 'b c'], 'a'), (['a d', 'b c', 'c e'], 'b'),
    (['map odom', 'odom map', 'b c'], 'b')])  # a loop
def test_the_proposed_fixed_frame(trees, fixed):
    """REP 105's names come first, wherever they are in a tree; then the largest tree, by name."""
    buffer = TransformBuffer()
    for tree in trees:
        arm(buffer, T, *tree.split())
    assert FrameWatcher(buffer).placement().fixed == fixed


#: Edges, what is shown 15 s later, in which those that are live have new stamps, and what is dead.
DYING = {
    'a frame whose stamp stands still': (
        'map live base, base frozen hand', 'map base', 'hand'),
    'a static frame below a dead one': (
        'map static post, map silent tip, tip static tool, tool static screw', 'map post', 'tip'),
    'a live frame below a dead one': (  # in a tree of its own, with the static frames of this tree
        'map silent odom, odom static base, base static laser, base live wheel',
        'odom base laser wheel', 'odom'),
    'a silent robot': ('map silent base, base silent hand', '', 'base hand')}


@pytest.mark.parametrize('name', DYING)
def test_what_dies(clock, name):
    """A dynamic frame has one age, and one limit; when it is back, all is there again."""
    text, shown, dead = DYING[name]
    edges = [edge.split() for edge in text.split(', ')]
    buffer = TransformBuffer()

    def send(stamp, *kinds):
        for parent, kind, child in edges:
            if kind in kinds:
                buffer.insert(T if kind == 'frozen' else stamp, parent, child, pose(1.0),
                              is_static=kind == 'static')

    watcher = FrameWatcher(buffer, lambda: clock[0])
    send(T, 'static', 'live', 'silent', 'frozen')
    names = watcher.placement().names
    clock[0] += 14.9
    send(T + S, 'live', 'frozen')
    assert watcher.placement().names == names
    clock[0] += 0.1
    placement = watcher.placement()
    assert (placement.names, placement.dead) == (shown.split(), dead.split())
    assert watcher.placement('', 0, 16.0).names == names
    send(T + 2 * S, 'silent')
    for edge in edges:
        edge[1] = edge[1].replace('frozen', 'live')
    send(T + 2 * S, 'live')
    assert (watcher.placement().names, watcher.placement().dead) == (names, [])


def test_at_most_2000_frames():
    """Those of the fixed frame's tree that came first are shown, each with its ancestors."""
    pytest.importorskip('viser')
    from viewer import StubFeed

    from puretf_tools.view.details import overview
    buffer = chain('world', 'tree')
    arm(buffer, T, 'map', 'base', 'arm', 'hand')
    for i in range(3000):
        arm(buffer, T, 'map', f'object_{i}')
    arm(buffer, T, 'map', 'base', 'late')
    placement = FrameWatcher(buffer).placement()
    assert {*placement.names} == {'map', 'base', 'arm', 'hand',
                                 *(f'object_{i}' for i in range(1996))}
    assert {*placement.left_out} == {'world', 'tree', 'late',
                                    *(f'object_{i}' for i in range(1996, 3000))}
    text = overview(placement, StubFeed(buffer))
    assert '>2000 of 3007 frames<' in text
    assert 'more than 2000, not shown: ' in text
    assert ' and 1002 more<' in text
    placement = FrameWatcher(buffer).placement('tree')
    assert {'world', 'tree', 'map', 'object_1993'} < {*placement.names}
    assert len(placement.names) == 2000


def test_ages(clock):
    """A dynamic frame has its own; a static one that of its parent, and a root none."""
    buffer = chain('map', 'upper', 'hand')
    buffer.insert(T, 'upper', 'post', pose(1.0), is_static=True)
    buffer.insert(T, 'hand', 'tool', pose(1.0), is_static=True)
    watcher = FrameWatcher(buffer, lambda: clock[0])
    watcher.placement()
    clock[0] += 10.0
    arm(buffer, T + S, 'upper', 'hand')
    for fixed in 'map', 'hand':
        placement = watcher.placement(fixed)
        assert dict(zip(placement.names, placement.ages)) == {
            'map': 0.0, 'upper': 10.0, 'post': 10.0, 'hand': 0.0, 'tool': 0.0}
    arm(buffer, T + S, 'map', 'upper')
    assert not watcher.placement('map').ages.any()


def test_ages_in_a_bag():
    """They count from the time that is shown, also in a gap of the data."""
    buffer = TransformBuffer(10**18)
    for second in 0, 1, 2, 8, 9:
        arm(buffer, T + second * S, 'map', 'base')
    watcher = FrameWatcher(buffer)
    assert watcher.placement('', T - S).names == []
    for second, age in (0, 0.0), (2, 0.0), (5, 3.0), (8, 0.0), (12, 3.0):
        assert watcher.placement('', T + second * S).ages.tolist() == [0.0, age]
    assert watcher.placement('', T + 24 * S).dead == ['base']


def test_frames_of_a_time():
    """The frames at a time have the parents and the samples that were known by then."""
    buffer = TransformBuffer()
    for second, parent in enumerate(['left', 'left', 'right', 'right']):
        buffer.insert(T + second * S, parent, 'hand', pose(1.0))
    buffer.insert(T, 'map', 'left', pose(1.0), is_static=True)

    def known(until):
        return [(frame.name, frame.parent, frame.length, frame.latest)
                for frame in buffer.frames(until)]

    assert known(T - 1) == [('left', 'map', 1, 0)]
    assert known(T + S) == [('hand', 'left', 2, T + S), ('left', 'map', 1, 0)]
    assert known(T + 5 * S // 2) == [('hand', 'right', 3, T + 2 * S), ('left', 'map', 1, 0)]
    assert known(0) == known(T + 9 * S) == [('hand', 'right', 4, T + 3 * S),
                                            ('left', 'map', 1, 0)]


FAR = [(1e7, 0.0, 0.0), (-1e200, 1e200, 0.0), (1e308, 1e308, -1e308), (0.0, -1e154, 3.0),
       (3e5, 4e5, -1e9), (-1.7e308, 0.0, 1.0)]


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('place', FAR)
def test_what_is_far_is_not_drawn(place):
    """Neither its axes nor lines to it, but its pose is known; what is below it is far, too."""
    buffer = chain('map', 'base', 'hand', 'tip')
    buffer.insert(T, 'map', 'near', pose(6e5, 8e5))
    buffer.insert(T, 'map', 'far', pose(*place))
    arm(buffer, T, 'far', 'below')
    buffer.insert(T, 'x', 'y', pose(*place))
    placement = FrameWatcher(buffer).placement()
    assert placement.far == ['far', 'below', 'y']
    assert placement.points[placement.names.index('near')].tolist() == [6e5, 8e5, 0.0]
    for name in 'far', 'y':
        i = placement.names.index(name)
        assert (placement.poses[i, :3].tolist(), placement.point(name)) == ([*place], None)
        assert placement.parents[i] == -1
    assert Display().shown(placement) == {'map', 'base', 'hand', 'tip', 'near', 'x'}
    assert np.abs(FrameWatcher(buffer).placement('far').points).max() < 1e6
    assert np.abs(axes(placement, Display())[0]).max() < 1e6
    assert len(lines(placement, Display())) == 4


def earth(root):
    """Return a buffer with a robot that is far from the root of its tree."""
    buffer = TransformBuffer()
    buffer.insert(T, root, 'map', pose(448_000.25, 5_300_000.5), is_static=True)
    for parent, child in ('map', 'base'), ('base', 'hand'), ('hand', 'tip'):
        buffer.insert(T, parent, child, pose(0.1, 0.2, 0.3), is_static=parent != 'map')
    return buffer


def test_a_robot_far_from_the_fixed_frame():
    """The scene has its origin at the robot, so that float32 numbers have all digits."""
    buffer = earth('utm')
    buffer.insert(T, 'base', 'lost', pose(float('inf')))
    watcher = FrameWatcher(buffer)
    placement = watcher.placement()
    assert (placement.fixed, placement.far) == ('map', ['utm', 'lost'])
    assert not placement.origin.any()
    placement = watcher.placement('utm')
    assert (placement.fixed, placement.far) == ('utm', ['utm', 'lost'])
    assert np.abs(placement.points[placement.names.index('map')]).max() < 1.0
    for x in range(0, 100_000, 1000):
        before = placement.origin
        buffer.insert(T + 1 + x, 'map', 'base', pose(x))
        placement = watcher.placement('utm')
        points = dict(zip(placement.names, placement.points))
        assert points['tip'] - points['base'] == pytest.approx([0.2, 0.4, 0.6], abs=1e-8)
        assert np.linalg.norm(points['base']) < 20_000
        assert np.linalg.norm(placement.origin - before) in (0.0, pytest.approx(11_000, abs=2000))


def test_axes_and_lines():
    """Each frame has axes, which are larger if it is selected, and a line to its parent."""
    buffer = TransformBuffer()
    buffer.insert(T, 'map', 'a', pose(0.0, 0.0, 2.0, (0.0, 0.0, HALF, HALF)))
    buffer.insert(T, 'a', 'b', pose(1.0, 2.0, 2.0))
    buffer.insert(T, 'a', 'c', pose(0.0, 0.0, 0.0))
    placement = FrameWatcher(buffer).placement()
    hidden = Display(hidden=frozenset(['c']))
    positions, wxyzs, scales = (dict(zip(placement.names, values.tolist()))
                                for values in axes(placement, hidden, 'b'))
    assert positions == {'map': [0, 0, 0], 'a': [0, 0, 2], 'b': [-2, 1, 4], 'c': [0, 0, 2]}
    for name in 'abc':
        assert wxyzs[name] == pytest.approx([HALF, 0.0, 0.0, HALF], abs=1e-4)
    assert scales == {'map': 1.0, 'a': 1.0, 'b': 1.5, 'c': 0.0}
    assert sorted(lines(placement, hidden).tolist()) == [
        [[-2, 1, 4], [0, 0, 2]], [[0, 0, 2], [0, 0, 0]]]


def test_axes_of_an_old_frame(clock):
    """After a third of the timeout they shrink, until the frame is gone."""
    watcher, found = FrameWatcher(chain('map', 'base'), lambda: clock[0]), []
    for seconds in 0.0, 10.0, 5.0, 5.0, 5.0:
        clock[0] += seconds
        found.append(axes(watcher.placement('', 0, 30.0), Display())[2].tolist())
    assert found == [[1.0, 1.0], [1.0, 1.0], [1.0, 0.75], [1.0, 0.5], [1.0, 0.25]]


def test_a_trail():
    """It covers the last 20 s in any fixed frame; while time passes, only one piece changes."""
    buffer = TransformBuffer(60 * S)
    watcher = FrameWatcher(buffer)

    def drawn(name, fixed='map', until=0):
        return trail(buffer, watcher.placement(fixed, until), name, Display())

    pieces, grown = drawn('hand'), []
    for i in range(3001):
        buffer.insert(T + i * S // 100, 'map', 'hand', pose(i / 100, 1.0))
        if i % 3 == 0:
            before, pieces = pieces, drawn('hand')
            grown.append(sum(number in before and not np.array_equal(before[number], lines)
                             for number, lines in pieces.items()))
    assert max(grown) == 1
    assert [*pieces] == sorted(pieces)
    lines = np.concatenate([*pieces.values()])
    assert lines.shape[0] > 300
    assert (lines[1:, 0] == lines[:-1, 1]).all()
    assert 10.0 <= lines[0, 0, 0] < 10.1
    assert lines[-1, 1].tolist() == [30.0, 1.0, 0.0]
    assert np.ptp(lines[..., 1]) == 0.0
    assert np.diff(lines[:, 0, 0]).max() < 0.1
    for fixed, name, second in ('hand', 'map', 30), ('map', 'hand', 1):
        *_, last = drawn(name, fixed, T + second * S).values()
        assert last[-1, 1] == pytest.approx(
            np.array([second, 1.0, 0.0]) * (1.0 if name == 'hand' else -1.0))
    assert not drawn('still')
    for second in 0, 1:
        buffer.insert(T + second * S, 'map', 'far', pose(1e7))
    assert not drawn('far')


def test_texts():
    """Names cannot inject HTML, and problems are reported."""
    pytest.importorskip('viser')
    from viewer import StubFeed

    from puretf_tools.view.details import details, overview
    buffer = TransformBuffer()
    feed = StubFeed(buffer, (0.00123, '/<i>'))
    assert 'no frames yet. because' in overview(FrameWatcher(buffer).placement(), feed)
    for tree in ('map', '<script>', 'b'), ('x\n', 'y', 'x\n'), ('w"orld', 'tree'):
        arm(buffer, T, *tree)
    placement = FrameWatcher(buffer).placement()
    text = overview(placement, feed, fixed='<b>')
    for part in ('>5 of 7 frames<', 'not connected to map: w&quot;orld', 'in a loop: ', '→ x\\n',
                 'other &lt;topics&gt;', 'the fixed frame &lt;b&gt; is not available'):
        assert part in text
    buffer.clear()
    arm(buffer, T, 'x', 'y', 'x')
    text = overview(FrameWatcher(buffer).placement(), feed)
    assert '>0 of 2 frames<' in text
    assert 'no frames yet' not in text
    buffer.clear()
    arm(buffer, T, 'map', '<script>', 'b')
    arm(buffer, T, 'w"orld', 'tree')
    text = details(placement, 'b', feed, buffer)
    for part in ('<b data-value="parent">&lt;script&gt;</b>', '"rate" title="">? Hz</td>',
                 '"delay" title="">1.23 ms</td>', '"publisher" title="">/&lt;i&gt;</td>',
                 f'"parent-time" title="{T // S}.000000000 s">{T // S}.000000000 s</td>'):
        assert part in text
    assert 'data-value="why">' not in text
    assert 'Could not find a connection' in details(placement, 'tree', feed, buffer)
    text = details(placement, 'map', feed, buffer)
    assert 'no parent: this is a root' in text
    assert '<b data-value="fixed">map</b>' in text
    buffer.clear()
    text = details(placement, 'b', feed, buffer)  # as after a jump of time or a long pause
    assert 'parent' in text
    assert 'nan' not in text
    assert '&lt;i&gt; is not available.' in details(placement, '<i>', feed, buffer)


def test_trees_that_change(page):
    """All roots are shown; frames appear, and move when they get another parent."""
    buffer = TransformBuffer()
    shown = page(buffer)
    viewer = shown.viewer
    shown.until(lambda: 'no frames yet. because' in viewer.text('overview'))
    for parent, child, x in ('map', 'odom', 1.0), ('map', 'left', 4.0), ('odom', 'base', 1.0):
        buffer.insert(T, parent, child, pose(x))
    shown.until(lambda: viewer.names() == {
        'map': [0, 0, 0], 'odom': [1, 0, 0], 'left': [4, 0, 0], 'base': [2, 0, 0]})
    shown.until(lambda: {*viewer.get('Frame', 'options')} == {
        '(none)', 'map', 'odom', 'left', 'base'})
    arm(buffer, T, 'world', 'tree')
    shown.until(lambda: viewer.names().get('tree') == [1, -2, 0])
    shown.until(lambda: 'not connected to map: world' in viewer.text('overview'))
    shown.set('Frame', 'tree')
    shown.until(lambda: viewer.detail('parent') == 'world')
    assert viewer.detail('parent-translation') == '1.000 0.000 0.000'
    assert not viewer.detail('fixed')  # its numbers would be equal
    for parent, child, x in ('map', 'left', 4.0), ('left', 'base', 1.0):
        buffer.insert(T + S, parent, child, pose(x))
    shown.until(lambda: viewer.names().get('base') == [5, 0, 0])
    shown.set('Fixed frame', 'left')
    shown.until(lambda: viewer.names().get('map') == [-4, 0, 0])


def rows(viewer):
    """Return the rows of the tree by their names: level, is unfolded, rate, age, hidden, marks."""
    return {name: row for name, *row in viewer.shown().get('rows', ())}


def shown_frames(viewer, placement):
    """Return the frames whose axes are drawn."""
    return {name for name, scale in zip(
        placement.names, viewer.axes('scales')) if scale > 0.0}


def look(shown):
    """Let the viewer look along z, from 5 m below the scene; x points right, y down."""
    shown.viewer.camera.update(position=[1.0, 0.0, -5.0], look_at=[1.0, 0.0, 0.0],
                               image_width=1600, image_height=1200)
    shown.viewer.send(shown.viewer.camera)
    shown.step()


@pytest.fixture
def tree(page):
    """A page with a tree of five frames, and their placement."""
    buffer = TransformBuffer()
    buffer.insert(T, 'map', 'odom', pose(1.0), is_static=True)
    for i in range(11):
        arm(buffer, T + i * S // 10, 'odom', 'base', 'hand')
        arm(buffer, T + i * S // 10, 'map', 'other')
    shown = page(buffer)
    shown.until(lambda: len(rows(shown.viewer)) == 5)
    return shown, FrameWatcher(buffer).placement()


def test_the_tree(tree, clock):
    """It has a row for each frame, with its rate and its age in tenths of the frame timeout."""
    shown, _ = tree
    assert rows(shown.viewer) == {
        'map': [0, True, '', None, False, []], 'odom': [1, True, 'static', None, False, []],
        'base': [2, True, '10.0 Hz', 0, False, []], 'hand': [3, None, '10.0 Hz', 0, False, []],
        'other': [1, None, '10.0 Hz', 0, False, []]}
    assert shown.viewer.shown()['selected'] == 'hand'
    assert shown.viewer.shown()['status'] == ['fixed frame map', '5 frames', '0.0 s']
    clock[0] += 7.0
    shown.until(lambda: rows(shown.viewer)['hand'] == [3, None, 'silent for 7 s', 5, False, []])
    shown.until(lambda: shown.viewer.detail('rate') == 'silent for 7 s')


def test_rows_fold(tree):
    """They fold and unfold; the page keeps which."""
    shown, _ = tree
    for is_open in False, True:
        shown.act('fold', 'odom')
        shown.until(lambda: rows(shown.viewer)['odom'][1] is is_open)  # noqa: B023


@pytest.mark.parametrize('text', [
    '', 'select', '1', '1 select', '1 select no_such', '1 fold \ud7ff', '1 finding', '1 step',
    '1 view behind', '1 kept', '1 speed 1', '1 a b c', ' ' * 99, 'x' * 60_000])
def test_nonsense_that_a_viewer_sends(tree, text):
    """It has no effect: the page goes on."""
    from viewer import update
    shown, _ = tree
    before = rows(shown.viewer)
    shown.viewer.send(update(shown.viewer.shown()['events'], value=text))
    shown.viewer.act('select', 'map')
    shown.until(lambda: shown.viewer.value('Frame') == 'map')
    shown.until(lambda: shown.viewer.shown()['selected'] == 'map')
    assert rows(shown.viewer) == before


@pytest.mark.parametrize(('text', 'found'), [
    ('', 'Left_Wheel right_wheel camera STRASSE'), ('  ', 'Left_Wheel right_wheel camera STRASSE'),
    ('wheel', 'Left_Wheel right_wheel'), ('WHEEL left', 'Left_Wheel'), ('lleft', ''),
    ('-left', 'right_wheel camera STRASSE'), ('wheel -left', 'right_wheel'),
    ('- wheel', 'Left_Wheel right_wheel'), ('--a', 'Left_Wheel right_wheel camera STRASSE'),
    ('straße', 'STRASSE'), ('.*', ''), ('^camera$', ''), ('(', ''), ('[a', ''), (r'(\w+)+!', '')])
def test_words_that_are_searched_for(text, found):
    """Each is in the name, in any order and case; one behind a hyphen is not. None is a regex."""
    pytest.importorskip('viser')
    from puretf_tools.view.tree_and_findings import filter_of
    names = 'Left_Wheel', 'right_wheel', 'camera', 'STRASSE'
    assert [name for name in names if filter_of(text)(name)] == found.split()


def test_frames_are_hidden(tree):
    """Alone or with their branches, or by filters; their bodies are not."""
    shown, placement = tree
    viewer = shown.viewer
    viewer.act('branch', 'odom')
    shown.until(lambda: shown_frames(viewer, placement) == {'map', 'other'})
    assert not {'odom', 'base', 'hand'} & viewer.names().keys()
    shown.until(lambda: rows(viewer)['base'][2:] == ['hidden', 0, True, []])
    viewer.act('branch', 'odom')
    viewer.act('hide', 'odom')
    shown.until(lambda: shown_frames(viewer, placement) == {'map', 'base', 'hand', 'other'})
    viewer.act('select', 'odom')
    viewer.press('H')
    shown.set('Include', 'a -ND')
    shown.until(lambda: shown_frames(viewer, placement) == {'map', 'base'})
    assert len(rows(viewer)) == 5
    shown.set('Include', '')
    shown.until(lambda: len(shown_frames(viewer, placement)) == 5)


def test_what_is_displayed(page, clock):
    """Axes, lines, names and the grid can be hidden; the timeout and the view be chosen."""
    shown = page(chain('map', 'base', 'hand'))
    viewer = shown.viewer
    shown.until(lambda: '/world/frames' in viewer.nodes and len(viewer.names()) == 3)
    shown.set('Axes', False)
    shown.until(lambda: not viewer.nodes['/world/frames']['visible'])
    assert viewer.nodes['/world/lines']['visible']
    shown.set('Lines to parents', False)
    shown.until(lambda: not viewer.nodes['/world/lines']['visible'])
    shown.set('Axes', True)
    shown.set('Show names', False)
    shown.until(lambda: not viewer.names())
    shown.set('Show names', True)
    shown.set('Grid', False)
    shown.until(lambda: not viewer.nodes['/world/grid']['visible'])
    viewer.set('View', 'top')  # from far, with a narrow angle
    shown.until(lambda: viewer.last['SetCameraPositionMessage']['position'][2] > 30.0)
    shown.until(lambda: viewer.last['SetCameraFovMessage']['fov'] == 0.1)
    shown.set('Dark', True)
    shown.until(lambda: viewer.last.get('ThemeConfigurationMessage', {}).get('dark_mode'))
    clock[0] += 6.0
    shown.set('Frame timeout (s)', 5)
    shown.until(lambda: 'stamp has arrived for 5 s: base, hand<' in viewer.text('overview'))
    shown.until(lambda: not viewer.names())


def test_the_camera_moves_to_frames(page):
    """To those that are not hidden, or to the selected one; a narrow page needs a distance."""
    shown = page(chain('map', 'base', 'hand', 'tip'))  # 1 m apart, along x

    def camera():
        return shown.viewer.last.get('SetCameraLookAtMessage', {}).get(
            'look_at', [0.0] * 3), shown.viewer.distance()

    shown.viewer.set('View', 'all')
    shown.until(lambda: camera()[1] > 5.0 and 1.4 < camera()[0][0] < 3.0)
    shown.set('Frame', 'tip')
    shown.update()
    shown.viewer.press('F')
    shown.until(lambda: camera()[0][0] > 2.9 and 1.7 < camera()[1] < 1.9)
    height = camera()[0][2]
    shown.set('Include', '-hand -tip')
    shown.update()
    shown.viewer.set('View', 'all')
    shown.until(lambda: camera()[0][0] < 1.0)
    shown.viewer.send({**shown.viewer.camera, 'image_width': 390, 'image_height': 800})
    shown.viewer.press('F')
    shown.until(lambda: camera()[0][2] == height and 3.6 < camera()[1] < 3.8)  # 0.5 m * 3.6 / 0.49


def test_the_camera_and_a_frame_that_is_far(page):
    """It does not count, so that the robot is seen; the trail and the names are there, too."""
    buffer = earth('utm')
    for i in range(1, 41):
        buffer.insert(T + i * S // 10, 'map', 'base', pose(0.1 + i / 10))
    shown = page(buffer)
    viewer = shown.viewer
    shown.set('Fixed frame', 'utm')
    shown.until(lambda: 'more than 1,000,000 m away, not drawn: utm<' in viewer.text('overview'))
    shown.until(lambda: viewer.detail('fixed') == 'utm')
    shown.set('Trail of', 'base')
    shown.until(lambda: len(viewer.trail()) > 70 and np.linalg.norm(
        viewer.trail()[-1, 1] - viewer.names()['base']) < 1e-3)
    assert np.diff(viewer.trail()[:, 0, 0]) == pytest.approx(0.05, abs=1e-4)
    shown.viewer.set('View', 'all')
    shown.until(lambda: 0.0 < viewer.distance() < 30.0)
    target = viewer.last['SetCameraLookAtMessage']['look_at']
    assert np.linalg.norm(np.subtract(viewer.names()['tip'], target)) < 10.0
    shown.set('Frame', 'utm')
    shown.step()
    viewer.last.clear()
    viewer.press('F')
    shown.step()
    assert not viewer.distance()


def place_in_scene(viewer, name):
    """Return where a name is in the scene, in which the camera stands still (m)."""
    world, (x, y, z) = viewer.nodes['/world'], viewer.names()[name]
    w, _, _, s = world.get('wxyz', (1.0, 0.0, 0.0, 0.0))
    cos, sin = w * w - s * s, 2 * w * s
    return np.add(world.get('position', (0.0, 0.0, 0.0)),
                  [cos * x - sin * y, sin * x + cos * y, z])


@pytest.mark.parametrize('with_yaw', [False, True])
def test_follow(page, with_yaw):
    """A frame that drives and turns stays in the picture, also with another fixed frame."""
    buffer = TransformBuffer()

    def drive(second):
        angle = 0.5 + 0.2 * second
        buffer.insert(T + round(second * S), 'map', 'base', pose(
            second, 2.0 * second, 0.1, (0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2))))
        buffer.insert(T + round(second * S), 'base', 'front', pose(1.0))

    drive(0)
    shown = page(buffer)
    viewer = shown.viewer
    shown.until(lambda: 'front' in viewer.names())
    shown.step()
    first = {name: place_in_scene(viewer, name) for name in ('base', 'front')}
    shown.set('Follow', 'base')
    shown.set('Follow its yaw', with_yaw)
    shown.step()
    for second in range(1, 6):
        drive(second)
        if second == 4:
            shown.set('Fixed frame', 'base')

        def stays():
            return second == 4 or viewer.names()['base'][:2] == [second, 2 * second]  # noqa: B023

        shown.until(stays)
        shown.step()
        places = {name: place_in_scene(viewer, name) for name in first}
        assert places['base'] == pytest.approx(first['base'], abs=1e-3)
        if second == 4:
            shown.set('Fixed frame', 'map')
        elif with_yaw:
            assert places['front'] == pytest.approx(first['front'], abs=1e-3)
        else:
            assert places['front'] - places['base'] == pytest.approx(
                [np.cos(0.5 + 0.2 * second), np.sin(0.5 + 0.2 * second), 0.0], abs=1e-3)
    shown.set('Follow', '(none)')
    drive(6)
    shown.until(lambda: viewer.names()['base'][:2] == [6, 12])
    shown.step()
    moved = np.linalg.norm(place_in_scene(viewer, 'base') - first['base'])
    assert moved == pytest.approx(5 ** 0.5, abs=1e-3)


@pytest.mark.parametrize('follow', ['(none)', 'base'])
def test_a_new_origin(page, follow):
    """A robot drives far away: in the scene it goes on, or stays if it is followed."""
    buffer = earth('utm')
    shown = page(buffer)
    viewer = shown.viewer
    shown.set('Fixed frame', 'utm')
    shown.set('Follow', follow)
    shown.until(lambda: viewer.detail('fixed') == 'utm')
    for _ in range(3):
        shown.step()
    first, origins = place_in_scene(viewer, 'base'), set()
    for x in range(8000, 48_000, 8000):
        buffer.insert(T + x, 'map', 'base', pose(0.1 + x, 0.2, 0.3))
        for _ in range(3):
            shown.step()
        origins.add(round(viewer.names()['base'][0] - x, -2))
        assert place_in_scene(viewer, 'base') - first == pytest.approx(
            [0.0 if follow == 'base' else x, 0.0, 0.0], abs=0.01)
    assert len(origins) > 2


def test_the_first_camera(page, clock):
    """It shows where the frames go in the first seconds, and again after a resize."""
    buffer = TransformBuffer()
    buffer.insert(T, 'map', 'base', pose(0.0), is_static=True)
    shown = page(buffer)
    viewer = shown.viewer
    shown.until(lambda: 0.0 < viewer.distance() < 4.0)
    for second in range(1, 5):
        buffer.insert(T + second * S, 'base', 'hand', pose(-10.0 if second == 3 else 1.0))
        shown.step()
    clock[0] += 5.0
    shown.until(lambda: viewer.distance() > 19.0)
    assert viewer.last['SetCameraLookAtMessage']['look_at'][0] < -3.5
    target = shown.server.initial_camera.look_at.tolist()
    there = shown.server.initial_camera.position.tolist()
    wide = {**viewer.camera, 'position': there, 'look_at': target}
    viewer.last.clear()
    viewer.storage['page'] = '390 800 0 0'
    viewer.send({**wide, 'image_width': 1170, 'image_height': 1200})
    shown.until(lambda: viewer.distance() > 30.0)  # a narrow page: 390 pixels of CSS
    shown.step()
    viewer.last.clear()
    viewer.send({**wide, 'position': [1.0, 2.0, 3.0]})  # the viewer moves it
    shown.step()
    viewer.send({**wide, 'position': [1.0, 2.0, 3.0], 'image_width': 1170, 'image_height': 1200})
    for _ in range(3):
        shown.step()
    assert not viewer.distance()


def test_a_late_report_of_the_camera(page, clock):
    """It says where the camera was before: nobody has moved it since, so it shows all frames."""
    buffer = TransformBuffer()
    buffer.insert(T, 'map', 'base', pose(0.0), is_static=True)
    shown = page(buffer)
    viewer, before = shown.viewer, shown.viewer.camera['position']
    shown.until(viewer.distance)
    for x, seconds in (10.0, 1.0), (20.0, 2.0):
        last = viewer.last['SetCameraPositionMessage']['position']
        viewer.send({**viewer.camera, 'position': before})
        shown.set('Grid', False)  # so that the server has handled the message before
        before = last
        buffer.insert(T, 'map', f'at {x}', pose(x), is_static=True)
        clock[0] += seconds
        shown.until(lambda: viewer.distance() > 1.5 * x)  # noqa: B023


def test_the_first_camera_shows_where_frames_have_been(page):
    """In the last 40 s, before the page was opened."""
    buffer = TransformBuffer(40 * S)
    for second in range(41):
        buffer.insert(T + second * S, 'map', 'base', pose(-float(second) if second < 30 else 0.0))
    shown = page(buffer)
    shown.until(lambda: shown.viewer.distance() > 40.0)
    assert shown.viewer.last['SetCameraLookAtMessage']['look_at'][0] < -11.0


def test_names_that_would_cover_others(page):
    """They are left out on a small page, but not that of the selected frame."""
    buffer = TransformBuffer()
    for i in range(4):
        buffer.insert(T, 'map', f'post_{i}', pose(0.0, 0.1 + 0.06 * i), is_static=True)
    shown = page(buffer)
    viewer = shown.viewer
    shown.until(lambda: len(viewer.names()) == 5)
    viewer.send({**viewer.camera, 'position': [3.0, 0.0, 0.0], 'wxyz': [0.5, 0.5, -0.5, -0.5],
                 'image_width': 800, 'image_height': 600})
    shown.until(lambda: len(viewer.names()) < 4)
    for name in 'post_1', 'post_3':
        viewer.set('Frame', name)
        shown.until(lambda: name in viewer.names())  # noqa: B023
        assert len(viewer.names()) < 4


@pytest.mark.parametrize('fixed', ['map', 'base', 'tip'])
def test_a_name_that_is_shared(page, fixed):
    """A static frame at its parent is in the label of the parent, whatever the fixed frame is."""
    buffer = TransformBuffer()
    for parent, child, x in ('map', 'base', 0.0), ('base', 'foot', 0.01), ('foot', 'tip', 1.0):
        buffer.insert(T, parent, child, pose(x), is_static=True)
    shown = page(buffer)
    shown.set('Fixed frame', fixed)
    shown.until(lambda: shown.viewer.names().keys() == {'map, base and 1 more', 'tip'})
    shown.set('Include', '-map')
    shown.until(lambda: shown.viewer.names().keys() == {'base, foot', 'tip'})


def test_each_viewer_has_settings_of_its_own(page):
    """Another fixed frame, other sizes; the other viewer sees nothing of it."""
    from viewer import Viewer
    shown = page(chain('map', 'base', 'hand'))
    other = Viewer(shown.server.get_port())
    other.until(lambda: '/world/frames' in other.nodes, shown.update)
    shown.set('Fixed frame', 'base')
    shown.set('Axis length (m)', 1.0)
    shown.until(lambda: shown.viewer.names().get('map') == [-1, 0, 0])
    shown.until(lambda: shown.viewer.nodes['/world/frames']['axes_length'] == 1.0)
    other.until(lambda: other.names().get('base') == [1, 0, 0], shown.update)
    assert other.value('Fixed frame') == 'map'
    assert other.nodes['/world/frames']['axes_length'] == 0.16
    other.close()
    shown.until(lambda: len(shown.server.get_clients()) == 1)
    shown.update()


def test_a_feed_is_watched_while_nobody_looks(monkeypatch):
    """Otherwise, what has arrived until the first viewer comes would be lost."""
    from viewer import StubFeed

    from puretf_tools.view.server import serve
    from puretf_tools.view.view import View
    feed, watched = StubFeed(TransformBuffer()), list[float]()
    monkeypatch.setattr(feed, 'watch', watched.append)
    with serve('127.0.0.1') as server:
        View(feed, server, lambda: 1000.0).update()
    assert watched == [1000.0]


def test_what_a_viewer_sets_is_not_set_back(page, monkeypatch):
    """The page may be updated between the setting of a value and the call of its callback."""
    import viser
    done = []

    def before(add):
        def with_update(*args, **kwargs):
            async def update(event):
                if event.client_id is None:
                    return
                (drawn,) = shown.view.viewers.values()
                if not drawn.pace.is_waiting:
                    shown.clock[0] += 1.0
                    shown.view.update()
                    done.append(event.target.label)

            control = add(*args, **kwargs)
            control.on_update(update)  # the first callback
            return control
        return with_update

    for name in 'add_checkbox', 'add_dropdown', 'add_slider':
        monkeypatch.setattr(viser.GuiApi, name, before(getattr(viser.GuiApi, name)))
    shown = page(chain('map', 'base'))
    viewer = shown.viewer
    shown.set('New frame', 'hand')
    values = {'Frame': 'map', 'Fixed frame': 'base', 'Show names': False,
              'Axis length (m)': 1.0, 'Publish': True}
    for label, value in values.items():
        shown.step()
        viewer.until(lambda: not any(each.pace.is_waiting for each in shown.view.viewers.values()))
        viewer.set(label, value)
        viewer.until(lambda: label in done)  # noqa: B023
    shown.until(lambda: [each.child_frame_id for each in shown.feed.sent] == ['hand'])
    assert viewer.value('Publish')
    shown.set('New frame', 'other')
    shown.until(lambda: not viewer.value('Publish'))  # what was sent before has arrived, too
    assert {label: viewer.value(label) for label in values} == {**values, 'Publish': False}


def test_a_viewer_that_leaves_publishes_no_more(page):
    """The frame placed by hand is stopped."""
    from viewer import Viewer
    shown = page(chain('map', 'base'))
    feed = shown.feed
    other = Viewer(shown.server.get_port())
    other.until(lambda: 'Publish' in {
        props.get('label') for props in other.gui.values()}, shown.update)
    other.set('New frame', 'hand')
    other.set('Publish', True)
    other.until(lambda: feed.sent, shown.update)
    assert not feed.stopped
    other.close()
    shown.until(lambda: feed.stopped == ['hand'])


def test_silences_are_remembered_while_viewers_look_back(page, clock):
    """A frame that has stopped meanwhile is not drawn as a fresh one."""
    buffer = TransformBuffer(40 * S)
    buffer.insert(T, 'map', 'base', pose(1.0), is_static=True)
    for second in range(2):
        buffer.insert(T + second * S, 'base', 'hand', pose(1.0))
    shown = page(buffer)
    shown.until(lambda: len(shown.viewer.names()) == 3)
    shown.act('pause')
    shown.update()
    shown.set('Back (s)', 1.0)
    shown.update()
    buffer.insert(T + 2 * S, 'base', 'hand', pose(1.0))
    shown.update()
    clock[0] += 16.0
    shown.act('pause')
    shown.until(lambda: shown.viewer.names().keys() == {'map', 'base'})


def test_frames_that_fade_and_return(page, clock):
    """They shrink, and vanish with their names and the trail, until they move again."""
    buffer = TransformBuffer()
    buffer.insert(T, 'map', 'base', pose(1.0), is_static=True)
    shown = page(buffer)
    viewer = shown.viewer
    for stamp in T, T + S // 2:
        arm(buffer, stamp, 'base', 'hand')
    shown.until(lambda: len(viewer.trail()) and len(viewer.names()) == 3)
    clock[0] += 12.5
    shown.until(lambda: viewer.axes('scales')[2] < 0.9)
    shown.until(lambda: viewer.detail('rate') == 'silent for 13 s')
    for name in 'base', 'hand':
        shown.set('Frame', name)
    clock[0] += 3.0
    shown.until(lambda: viewer.names().keys() == {'map', 'base'})
    shown.until(lambda: not len(viewer.trail()))
    assert len(viewer.nodes['/world/lines']['points']) == 6
    why = 'no transform with a newer stamp has arrived for 15 s'
    shown.until(lambda: f'not shown, because {why}: hand<' in viewer.text('overview'))
    assert '2 frames' in viewer.shown()['status']
    assert '>2 of 3 frames<' in viewer.text('overview')
    shown.until(lambda: f'hand is not available: {why}.' in viewer.text('details'))
    shown.act('pause')  # so it is drawn as at the end
    shown.until(lambda: viewer.names().keys() == {'map', 'base', 'hand'})
    shown.act('pause')
    arm(buffer, T + 16 * S, 'base', 'hand')
    shown.until(lambda: viewer.names().keys() == {'map', 'base', 'hand'})
    shown.until(lambda: viewer.axes('scales')[2] == 1.5)  # it is selected


def test_a_long_pause(page, clock):
    """The last 20 s stay, also for another fixed frame and the pair; and so do the choices."""
    buffer = TransformBuffer(40 * S)

    def pass_by(first, last):
        for second in range(first, last):
            buffer.insert(T + second * S, 'map', 'base', pose(second))
            buffer.insert(T + second * S, 'base', 'hand', pose(1.0))

    pass_by(0, 31)
    shown = page(buffer)
    viewer = shown.viewer
    shown.until(lambda: viewer.names().get('hand') == [31, 0, 0])
    choices = [(label, viewer.value(label)) for label in ('Frame', 'Trail of', 'Fixed frame')]
    assert [value for _, value in choices] == ['hand', 'hand', 'map']
    shown.act('pause')
    shown.step()
    pass_by(31, 130)
    clock[0] += 99.0
    for back in 5, 20, 0:
        shown.set('Back (s)', float(back))
        shown.until(lambda: viewer.names().get('hand') == [31 - back, 0, 0])  # noqa: B023
    shown.until(lambda: len(viewer.trail()) > 300)
    shown.set('Fixed frame', 'hand')
    shown.until(lambda: viewer.names().get('map') == [-31, 0, 0])
    shown.set('Back (s)', 3.0)
    shown.until(lambda: viewer.names().get('map') == [-28, 0, 0])
    shown.set('A', 'map')
    shown.set('B', 'hand')
    shown.until(lambda: '28.000' in viewer.text('pair'))
    shown.set('Fixed frame', '(automatic)')
    assert viewer.get('Back (s)', 'visible')
    assert viewer.get('Live', 'options') == ['resume', 'reset']
    shown.act('pause')
    shown.until(lambda: viewer.names().get('hand') == [130, 0, 0])
    shown.until(lambda: viewer.value('Back (s)') == 0.0 and not viewer.get('Back (s)', 'visible'))
    assert [(label, viewer.value(label)) for label, _ in choices] == choices


def test_what_is_chosen_stays(page):
    """A choice outlasts new proposals, even while the chosen frame does not exist."""
    buffer = chain('map', 'base', 'hand')
    shown = page(buffer)
    viewer = shown.viewer
    shown.until(lambda: viewer.value('Fixed frame') == 'map')  # proposed
    shown.set('Fixed frame', 'base')
    shown.until(lambda: viewer.names().get('map') == [-1, 0, 0])
    buffer.clear()
    arm(buffer, T, 'map', 'other', 'more')
    shown.until(lambda: 'the fixed frame base is not available; instead of it: map<' in
                viewer.text('overview'))
    shown.until(lambda: 'base' in viewer.get('Fixed frame', 'options'))
    arm(buffer, T, 'map', 'base')
    shown.until(lambda: viewer.names().get('map') == [-1, 0, 0])
    assert viewer.value('Fixed frame') == 'base'
    shown.set('Frame', '(none)')
    shown.until(lambda: 'Click a frame' in viewer.text('details'))


def test_the_fixed_frame_of_a_page_that_nobody_has_chosen(page, clock):
    """It changes by itself: when a better one appears, and when it is dead."""
    buffer = chain('base_lnk', 'laser', 'tip')
    shown = page(buffer)
    viewer = shown.viewer

    def options():
        return viewer.get('Fixed frame', 'options')

    shown.until(lambda: viewer.value('Fixed frame') == 'base_lnk')
    arm(buffer, T, 'map', 'base_link')
    shown.until(lambda: viewer.value('Fixed frame') == 'map')
    shown.until(lambda: 'not connected to map: base_lnk' in viewer.text('overview'))
    shown.set('Frame', 'laser')
    shown.until(lambda: viewer.detail('parent') == 'base_lnk')
    clock[0] += 16.0
    arm(buffer, T + S, 'odom', 'base_link')
    shown.until(lambda: viewer.value('Fixed frame') == 'odom')
    shown.until(lambda: viewer.names().keys() == {'odom', 'base_link'})
    shown.until(lambda: options() == ['(automatic)', 'base_link', 'odom'])
    shown.until(lambda: 'not connected' not in viewer.text('overview'))
    shown.until(lambda: viewer.get('Frame', 'options') == [
        '(none)', 'base_link', 'laser', 'odom'])  # laser is chosen
    arm(buffer, T + S, 'base_lnk', 'laser')
    shown.until(lambda: 'laser' in options() and viewer.detail('parent') == 'base_lnk')


def test_a_name_keeps_its_label(page, clock):
    """So that only what changes is sent when a frame in between appears or leaves."""
    buffer = TransformBuffer()

    def insert(stamp, **heights):
        for child, z in heights.items():
            buffer.insert(stamp, 'map', child, pose(0.0, 0.0, z))

    insert(T, first=1.0, second=2.0, third=3.0)
    shown = page(buffer)

    def labels():
        return {node['text']: name for name, node in shown.viewer.nodes.items()
                if name.startswith('/world/names/') and node.get('visible')}

    shown.until(lambda: len(labels()) == 4)
    before = labels()
    clock[0] += 16.0
    insert(T + S, first=1.0, third=3.0)
    shown.until(lambda: labels().keys() == {'map', 'first', 'third'})
    after = labels()
    assert after.items() < before.items()
    insert(T + S, fourth=4.0)
    shown.until(lambda: 'fourth' in labels())
    assert after.items() < labels().items()
    # The label of a frame that has left is not used for another one.
    assert labels()['fourth'] not in before.values()


@pytest.mark.parametrize('what', ['axis', 'name'])
def test_a_click_selects_a_frame(page, what):
    """On its axes, or on its name; a click beside them does not."""
    shown = page(chain('map', 'base', 'hand'))
    viewer = shown.viewer
    shown.until(lambda: len(viewer.names()) == 3)
    shown.until(lambda: viewer.detail('parent') == 'base')  # of hand
    place = np.array(viewer.names()['base'])
    if what == 'axis':
        shown.set('Show names', False)
    look(shown)
    viewer.click(place + ((0.0, 0.05, 0.0) if what == 'axis' else (0.05, -0.03, 0.0)))
    shown.until(lambda: viewer.detail('parent') == 'map')
    shown.until(lambda: viewer.axes('scales').tolist() == [1.0, 1.5, 1.0])
    viewer.click(place + (0.0, 0.6, 0.0))
    for _ in range(3):
        shown.step()
    assert viewer.detail('parent') == 'map'


def test_a_bag_is_played(page, clock):
    """A viewer sets the time; many names are hidden at first; the dropdowns keep all names."""
    buffer = moving(S)
    for i in range(60):
        buffer.insert(T, 'map', f'post_{i}', pose(0.0, i), is_static=True)
    buffer.insert(T + 9 * S, 'map', 'late', pose(0.0))
    shown = page(BagFeed(buffer, 'bag'))
    viewer = shown.viewer
    shown.until(lambda: '62 frames' in viewer.shown().get('status', ()))
    assert viewer.last['SetGuiPanelLabelMessage']['label'] == 'bag'
    assert not viewer.names()
    assert not viewer.value('Show names')
    shown.set('Show names', True)
    shown.act('pause')
    shown.act('seek', '7')
    shown.until(lambda: viewer.names().get('base') == [7, 0, 0] and any(
        name.startswith('post_') for name in viewer.names()))
    clock[0] += 5.0
    shown.update()
    shown.act('pause')
    shown.until(lambda: 7 < viewer.names().get('base', [0])[0] < 10)
    shown.until(lambda: viewer.shown('bar')['position'] > 7)
    clock[0] += 5.0
    shown.until(lambda: viewer.names().get('base', [9])[0] < 5)  # it starts again
    shown.until(lambda: 'late' in viewer.get('Frame', 'options'))
    assert 'late' not in viewer.names()


def json_of(viewer):
    """Return the view that the page has stored in the browser."""
    return json.loads(next((text for key, text in viewer.storage.items() if key.endswith(' 0')),
                           '{}'))


def test_the_view_stays(page, clock):
    """What a viewer has set is stored in the browser; the next connection begins with it."""
    from viewer import Viewer
    shown = page(chain('map', 'base', 'hand'))
    viewer = shown.viewer
    shown.until(lambda: viewer.shown())
    values = {'Frame': 'base', 'Fixed frame': 'base', 'Axis length (m)': 0.5, 'Grid': False,
              'Include': '-hand', 'Show names': False, 'Dark': True, 'A': 'map', 'B': 'hand'}
    for label, value in values.items():
        shown.set(label, value)
    shown.act('branch', 'base')
    look(shown)
    camera = [1.0, 0.0, -5.0, 1.0, 0.0, 0.0, 0.8]
    clock[0] += 2.0
    shown.until(lambda: json_of(viewer).get('Hidden branches') == ['base']
                and json_of(viewer)['Camera'] == camera)
    assert json_of(viewer).items() >= values.items()
    other = Viewer(shown.server.get_port(), position=[9.0, 9.0, 9.0])
    other.storage = viewer.storage
    other.until(lambda: 'SetCameraFovMessage' in other.last and 'A' in {
        props.get('label') for props in other.gui.values()}, shown.update)
    other.until(lambda: other.value('A') == 'map' and other.value('B') == 'hand', shown.update)
    assert {label: other.value(label) for label in values} == values
    assert other.last['SetCameraPositionMessage']['position'] == camera[:3]
    other.until(lambda: other.last['ThemeConfigurationMessage']['dark_mode'], shown.update)
    other.until(lambda: rows(other).get('base', [''] * 5)[4] is True, shown.update)
    other.close()
    viewer.press('R')  # forgets all of it
    shown.until(lambda: viewer.value('Frame') == 'hand' and viewer.value('Fixed frame') == 'map')
    assert viewer.value('Grid')
    shown.until(lambda: viewer.names().keys() == {'map', 'base', 'hand'})
    clock[0] += 2.0
    shown.until(lambda: json_of(viewer)['Hidden branches'] == [])


def test_a_view_is_copied_and_pasted(page):
    """As a line of JSON, also into the page of another one; what it does not say stays."""
    buffer = chain('map', 'base', 'hand')
    shown, other = page(buffer), page(buffer, view='{"Frame": "map", "Grid": false}')
    other.until(lambda: other.viewer.value('Frame') == 'map' and not other.viewer.value('Grid'))
    shown.set('Frame', 'base')
    shown.viewer.act('kept', 'copy view')
    shown.until(lambda: shown.viewer.text('view'))
    text, = re.findall('data-text="view"[^>]*>([^<]*)<', shown.viewer.text('view'))
    other.set('Paste view', unescape(text))
    other.until(lambda: other.viewer.value('Frame') == 'base' and other.viewer.value('Grid'))
    other.set('Paste view', '{"Frame": "hand"}')
    other.until(lambda: other.viewer.value('Frame') == 'hand')
    assert other.viewer.value('Grid')


#: Views that are refused, and what the page says.
REFUSED = [
    *((text, 'this is no view') for text in ('nonsense', '[1]', '[' * 5000, '9' * 5000)),
    *((f'{{"{name}": {value}}}', f'{name} cannot be ') for name, values in {
        'Axis length (m)': (f'1{"0" * 400}', '1e999', 'NaN', '0', 'true', '"1"', 'null'),
        'Frame timeout (s)': ['61'], 'Axes': ['"yes"'], 'Frame': ['"\\ud800"'],
        'Include': [f'"{"x" * 1025}"'], 'Hidden': ('[1]', '"a"', '["\\udcff"]'),
        'Plot over': ['"x"'], 'Camera': [f'[0, 0, 1, 0, 0, 0, {value}]' for value in (
            'NaN', '0', '4', 'null', '1, 1')] + ['[0, 0, 1e99, 0, 0, 0, 1]']}.items()
      for value in values)]


@pytest.mark.parametrize(('text', 'problem'), REFUSED, ids=range(len(REFUSED)))
def test_a_view_that_is_refused(text, problem):
    """The reason names the control, its value and a remedy, and is short; nothing is set."""
    from puretf_tools.view.settings import Settings
    settings = Settings()
    why = settings.restore(text)
    assert why.startswith(problem)
    assert why.endswith(': copy the line that "copy view" shows')
    assert len(why) < 160
    assert (why + settings.as_json()).isascii()
    assert settings.as_json() == '{}'


@pytest.mark.parametrize('is_kept', [False, True])
def test_a_refused_view_of_a_viewer(page, is_kept):
    """Whether it is pasted or was kept: the page says why, goes on, and keeps a right one."""
    text, problem = '{"Frame": "map", "Axis length (m)": NaN}', 'Axis length (m) cannot be NaN'
    shown = page(chain('map', 'base'), storage={'/tf 0': text} if is_kept else {})
    viewer = shown.viewer
    shown.until(viewer.names)
    if is_kept:
        shown.until(lambda: any(
            problem in str(props.get('body')) for props in viewer.gui.values()))
    else:
        viewer.set('Paste view', text)
        shown.until(lambda: problem in unescape(viewer.text('paste')))
    assert viewer.value('Frame') == 'base'
    shown.set('Frame', 'map')
    shown.until(lambda: 'this is a root' in viewer.text('details'))
    shown.clock[0] += 2.0
    shown.until(lambda: json_of(viewer).get('Frame') == 'map')


def test_a_view_of_a_bag_in_a_live_page(page):
    """What only a bag can be plotted over is left as it was."""
    shown = page(chain('map', 'base'), view='{"Plot over": "whole bag", "A": "map", "B": "base"}')
    shown.until(lambda: '>1.000<' in shown.viewer.text('pair'))
    assert shown.viewer.value('Plot over') == '20 s'


def test_a_view_that_is_too_long_to_come_back(page):
    """It is not stored: the browser could not send it, and nobody could load the page again."""
    shown = page(chain('map', 'base'))
    viewer = shown.viewer
    shown.until(viewer.names)
    hidden = ['é' * 400 + str(i) for i in range(60)]
    shown.set('Paste view', json.dumps({'Hidden': hidden, 'Frame': 'map'}, ensure_ascii=False))
    shown.until(lambda: viewer.value('Frame') == 'map')
    for _ in range(3):
        shown.clock[0] += 2.0
        shown.step()
    assert json_of(viewer).get('Frame') is None
    shown.set('Paste view', '{"Hidden": []}')
    shown.clock[0] += 2.0
    shown.until(lambda: json_of(viewer).get('Frame') == 'map')


def test_an_error_of_one_viewer(page, monkeypatch, logs):
    """It ends the session of this viewer, with a line in the log; the other one goes on."""
    from viewer import Viewer
    from websockets.exceptions import ConnectionClosed

    from puretf_tools.view.pair import Pair
    update = Pair.update

    def fail(pair, *args):
        if pair.frames[0] == 'map':
            raise OverflowError('too \x1b[2J large')
        update(pair, *args)

    monkeypatch.setattr(Pair, 'update', fail)
    shown = page(chain('map', 'base'))
    bad = Viewer(shown.server.get_port())
    bad.until(lambda: 'map' in (bad.get('A', 'options') or ()), shown.update)
    bad.set('A', 'map')
    with pytest.raises(ConnectionClosed):
        bad.until(lambda: False, shown.update)
    record, = logs
    assert record.getMessage() == 'a viewer is disconnected: OverflowError: too \\x1b[2J large'
    shown.set('Frame', 'map')
    shown.until(lambda: 'this is a root' in shown.viewer.text('details'))
    shown.until(lambda: len(shown.view.viewers) == 1)


def test_the_time_of_a_bag_stays(page, clock):
    """After a restart, the page goes on where it was, unless somebody else looks at the bag."""
    feed = BagFeed(moving(S), 'bag')
    feed.player.plays = False
    shown = page(feed, storage={'bag 0': json.dumps({'Time': T + 7 * S})})
    shown.until(lambda: shown.viewer.names().get('base', [0])[0] == 7)


def test_the_pair(page):
    """A line connects its frames; a button swaps them, and Shift chooses them."""
    shown = page(chain('map', 'base', 'hand'))
    viewer = shown.viewer
    shown.until(lambda: len(viewer.names()) == 3)
    shown.set('A', 'hand')
    shown.set('B', 'map')
    shown.until(lambda: viewer.value('A') == 'hand' and viewer.value('B') == 'map')
    shown.until(lambda: viewer.nodes.get('/world/pair', {}).get('visible') and viewer.nodes[
        '/world/pair']['points'].tolist() == [2, 0, 0, 0, 0, 0])
    viewer.set('Frames', 'swap')
    shown.until(lambda: viewer.value('A') == 'map' and '>2.000<' in viewer.text('pair'))
    look(shown)
    viewer.click(viewer.names()['base'], modifier='shift')
    shown.until(lambda: viewer.value('A') == 'hand' and viewer.value('B') == 'base')
    shown.set('B', '(none)')
    shown.until(lambda: not viewer.nodes['/world/pair']['visible'])


def test_the_keys(page):
    """P pauses, B and N step, A, F and T move the camera; a button forgets the transforms."""
    shown = page(moving(S // 10))
    viewer = shown.viewer
    shown.until(lambda: viewer.names().get('base') == [10, 0, 0])
    for key, x in ('B', 9), ('B', 8), ('N', 9), ('P', 10):
        viewer.press(key)
        shown.until(lambda: viewer.names().get('base') == [x, 0, 0])  # noqa: B023
    assert viewer.get('Live', 'options') == ['pause', 'reset']
    for key in 'F', 'A', 'T':
        viewer.last.clear()
        viewer.press(key)
        shown.until(lambda: 'SetCameraPositionMessage' in viewer.last)
    viewer.set('Live', 'reset')
    shown.until(lambda: 'no frames yet' in viewer.text('overview'))


def colours(viewer, kind):
    """Return the colours of lines."""
    return [node['colors'].tolist() for name, node in sorted(viewer.nodes.items())
            if name.startswith(f'/world/{kind}') and 'colors' in node]


def test_the_grid_and_the_trail(page):
    """The grid goes with the followed frame, by whole cells; an old trail is as the background."""
    buffer = TransformBuffer(40 * S)
    for second in range(21):
        buffer.insert(T + second * S, 'map', 'base', pose(200.3 - 0.1 * second, 99.9))
    shown = page(buffer)
    viewer = shown.viewer
    shown.until(lambda: len(colours(viewer, 'trail')) == 21)
    for is_dark, grey in (False, 255), (True, 20):
        shown.set('Dark', is_dark)
        oldest = [int(grey + (value - grey) / 21) for value in (200, 60, 200)]
        shown.until(lambda: colours(viewer, 'trail')[::20] == [
            oldest, [200, 60, 200]])  # noqa: B023
    assert colours(viewer, 'lines') == [[125, 125, 125]]
    assert 'position' not in viewer.nodes['/world/grid']
    shown.set('Follow', 'base')  # at x = 198.3
    shown.until(lambda: [*viewer.nodes['/world/grid'].get('position', ())] == [198.5, 100.0, 0.0])


@pytest.mark.parametrize(('is_bag', 'seconds', 'x'), [(False, -0.3, 7), (True, 0.3, 3)])
def test_a_click_in_a_plot(page, is_bag, seconds, x):
    """The page pauses, and shows the time there."""
    buffer = moving(S // 10)
    shown = page(BagFeed(buffer, 'bag') if is_bag else buffer,
                 view='{"A": "map", "B": "base", "Plot over": "20 s"}')
    viewer = shown.viewer
    shown.until(lambda: viewer.get('translation', 'visible') or 'distance' in viewer.text('pair'))
    viewer.storage['page'] = f'800 600 1 {seconds}'
    shown.until(lambda: viewer.names().get('base') == pytest.approx([x, 0, 0], abs=1e-3))


@pytest.mark.parametrize('changes', [
    {'up_direction': [0.55, -0.7, 0.45]}, {'position': [1e308] * 3, 'look_at': [-1e308] * 3}])
def test_a_camera_that_cannot_be_turned(page, changes):
    """The page goes on, and the cameras of the others are turned."""
    from viewer import Viewer
    shown = page(chain('map', 'base'))
    other = Viewer(shown.server.get_port(), **changes)
    shown.clock[0] += 2.0  # all cameras are turned
    # viser moves this point together with the position first.
    shown.until(lambda: shown.viewer.last.get('SetCameraLookAtMessage', {}).get('look_at')
                == pytest.approx(shown.server.initial_camera.look_at))
    other.close()
    shown.act('pause')
