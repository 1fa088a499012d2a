"""The part of the page that shows the transform between two frames that a viewer chooses."""

from html import unescape
from math import cos, sin
import re
import shlex

import numpy as np
import pytest

from puretf import Transform, TransformBuffer

pytest.importorskip('viser', reason='viser, which makes the page, is not installed')

from viewer import Viewer

from puretf_tools.view.feed import Feed
from puretf_tools.view.pair import Pair
from puretf_tools.view.server import serve
from puretf_tools.view.settings import Settings

S = 10**9
T = 1_700_000_000 * S
HALF = 0.5 ** 0.5


class Shown:
    """A pair on a page, and what its viewer gets."""

    def __init__(self, server, buffer):
        """Connect a viewer."""
        self.count, self.buffer = 0, buffer
        feed = Feed()
        feed.buffer = buffer
        self.pair = Pair(server.gui, Settings(), feed)
        self.viewer = Viewer(server.get_port())
        self.viewer.until(lambda: len(self.plots()) == 2)

    def update(self, end=0):
        """Show a time (ns), or the latest."""
        self.count += 1
        self.pair.update(self.buffer, end)

    def offer(self, *names):
        """Set the frames that can be chosen."""
        for choice in self.pair.choices:
            choice.set_options(names)

    def choose(self, a, b, end=0):
        """Choose two frames, and update until something is shown."""
        self.offer('map', 'base', a, b)
        self.viewer.until(lambda: a in self.viewer.get('A', 'options'))
        for label, name in ('A', a), ('B', b):
            self.viewer.set(label, name)
        self.viewer.until(self.text, lambda: self.update(end))

    def receive_all(self):
        """Wait until the viewer has got all that has been sent."""
        last = f'frame_{self.count}'
        self.offer('map', 'base', last)
        self.viewer.until(lambda: last in self.viewer.get('A', 'options'))

    def text(self):
        """Return the table or the hint."""
        return self.viewer.text('pair')

    def rows(self):
        """Return the cells in each row of the table, after the one with the label."""
        return [re.findall('<t[dh][^>]*>([^<]*)', row)[1:] for row in self.text().split('<tr')[1:]]

    def translation(self):
        """Return x, y, z (m) in the table; [] if there is none."""
        return [float(cell) for row in self.rows()[1:2] for cell in row]

    def plots(self):
        """Return the properties of the two plots."""
        return [props for props in self.viewer.gui.values() if 'series' in props]

    def plotted(self):
        """Return the values of both plots, (2, 4, n): s; x, y, z (m) and roll, pitch, yaw (°)."""
        return np.array([plot['data'] for plot in self.plots()])

    def copied(self):
        """Return the lines to copy."""
        self.viewer.until(lambda: self.viewer.text('copy'))
        return [*map(unescape, re.findall('<pre[^>]*>([^<]*)</pre>', self.viewer.text('copy')))]


@pytest.fixture
def buffer():
    """A buffer of one minute."""
    return TransformBuffer(60 * S)


@pytest.fixture
def shown(buffer):
    """The pair of frames of `buffer`."""
    with serve('127.0.0.1') as server:
        shown = Shown(server, buffer)
        yield shown
        shown.viewer.close()


def test_nothing_is_shown_until_a_pair_is_chosen(shown, buffer):
    """One frame is not enough, and the plots vanish when one is taken back."""
    buffer.insert(T, 'map', 'base', (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0))
    viewer = shown.viewer
    shown.offer('map', 'base')
    viewer.until(lambda: viewer.get('A', 'options') == ['(none)', 'base', 'map'])
    viewer.set('A', 'map')
    shown.update()
    assert not shown.text()
    assert not any(plot['visible'] for plot in shown.plots())
    shown.choose('map', 'base')
    viewer.until(lambda: all(plot['visible'] for plot in shown.plots()))
    viewer.set('B', '(none)')
    viewer.until(lambda: not any(plot['visible'] for plot in shown.plots()), shown.update)
    assert not shown.text()


def test_the_numbers_of_a_pair(shown, buffer):
    """The table shows the pose of B in A: a quarter turn about z, 1 m along x."""
    buffer.insert(T, 'map', 'base', (1.0, 0.0, -0.25, 0.0, 0.0, HALF, HALF))
    shown.choose('map', 'base')
    assert shown.rows()[0] == ['1700000000.000000000 s']
    assert shown.translation() == [1.0, 0.0, -0.25]
    assert [[*map(float, row)] for row in shown.rows()[2:]] == [
        [0.0, 0.0, 0.7071, 0.7071], [1.031], [90.0], [0.0, 0.0, 90.0], [0.0, 0.0, 1.5708],
        [0.0, -1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, -0.25], [0.0, 0.0, 0.0, 1.0]]
    shown.choose('base', 'map')
    shown.viewer.until(lambda: shown.translation() == [0.0, 1.0, 0.25], shown.update)
    assert shown.rows()[5] == ['0.00', '0.00', '-90.00']


def test_the_values_of_the_last_20_s(shown, buffer):
    """The plots end at the time shown, and have nothing where there is no transform."""
    for i in range(201):
        t = i / 10.0
        yaw = 0.3 * t  # passes 180° at 10.5 s
        buffer.insert(T + i * S // 10, 'elsewhere' if 5.0 < t < 10.0 else 'map', 'base',
                      (t, 0.0, -t, 0.0, 0.0, sin(yaw / 2), cos(yaw / 2)))
    shown.choose('map', 'base', T + 15 * S)
    assert shown.rows()[0] == ['1700000015.000000000 s']
    shown.viewer.until(lambda: all(plot['visible'] for plot in shown.plots()))
    shown.receive_all()
    (seconds, x, y, z), (same_seconds, roll, pitch, yaw) = shown.plotted()
    assert seconds.tolist() == same_seconds.tolist()
    t = np.round(seconds + 15.0, 3)
    assert {*t} >= {*np.arange(0, 5.001, 0.05).round(3), *np.arange(10, 15.001, 0.05).round(3)}
    assert ((t >= 0.0) & (t < 5.1) | (t >= 9.9) & (t <= 15.0)).all()
    is_known = (t <= 5.0) | (t >= 10.0)
    degrees = np.degrees(0.3 * t)
    for values, expected in ((x, t), (y, 0.0 * t), (z, -t), (roll, 0.0 * t), (pitch, 0.0 * t),
                             (yaw, np.where(degrees > 180.0, degrees - 360.0, degrees))):
        assert values[is_known] == pytest.approx(expected[is_known])


def test_no_transform(shown, buffer):
    """The hint of the library is shown, without HTML of the names; the plots are hidden."""
    for parent, child in ('map', 'base'), ('<b>', 'tool'):
        buffer.insert(T, parent, child, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    shown.choose('map', '<b>')
    assert unescape(shown.text()).count(buffer.why_not('map', '<b>', 0)) == 1
    assert '<b>' not in shown.text()
    shown.choose('nowhere', 'nowhere')
    shown.viewer.until(lambda: 'the same frame' in shown.text(), shown.update)
    assert not any(plot['visible'] for plot in shown.plots())


@pytest.mark.parametrize('child', ['base', "it's a <b>", '-b', '$(x)'])
def test_texts_to_copy(shown, buffer, child, monkeypatch):
    """The command gives the transform to 1e-9, and the line of Python to the last bit."""
    pytest.importorskip('rclpy', reason='the command needs ROS')
    from puretf_tools.commands import static_transform_publisher
    pose = 1.0 / 3.0, -1e-7, -2e5 / 7.0, 0.5, -0.5, 0.5, -0.5
    buffer.insert(T, 'map', child, pose)
    shown.choose('map', child)
    command, python = shown.copied()
    given = []
    monkeypatch.setattr(static_transform_publisher, 'command',
                        lambda *args, **kwargs: given.append(args[:4]))
    name, *args = shlex.split(command)
    assert name == 'static_transform_publisher'
    static_transform_publisher.main(args)
    (translation, rotation, *frames), = given
    assert [*translation, *rotation] == pytest.approx(pose, abs=1e-9)
    assert frames == ['map', child]
    names: dict[str, Transform] = {}
    exec(python, names)
    assert names['transform'] == Transform(T, 'map', child, pose[:3], pose[3:])


def test_names_that_a_terminal_would_not_print(shown, buffer):
    """They are in the line of Python, escaped, but in no command."""
    buffer.insert(T, 'map', 'tool\x1b\n', (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    shown.choose('map', 'tool\x1b\n')
    python, = shown.copied()
    assert python.isprintable()
    names: dict[str, Transform] = {}
    exec(python, names)
    assert names['transform'].child_frame_id == 'tool\x1b\n'


@pytest.mark.parametrize('x', [1e300, 1.7e308, float('inf')])
def test_a_pair_that_is_far(shown, buffer, x):
    """Numbers that are not finite are not plotted."""
    for parent, child in ('map', 'mid'), ('mid', 'base'):
        buffer.insert(0, parent, child, (x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), is_static=True)
    shown.choose('map', 'base')
    assert shown.rows()[0] == ['all times']
    shown.receive_all()
    is_finite = x == 1e300  # the sum of two of them
    assert [plot['visible'] for plot in shown.plots()] == [is_finite] * 2
    if is_finite:
        assert np.isfinite(shown.plotted()).all()
        assert {*shown.plotted()[1, 3].tolist()} == {0.0}
