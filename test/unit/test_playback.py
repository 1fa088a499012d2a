"""The controls of a bag in the page of web_view, and the page that plays without a server."""

import json
import os
import re
import signal

from environment import ROOT
import numpy as np
import pytest

from puretf import bag, TransformBuffer
from puretf_tools.cli.signals import (
    check_signals,
    record_signals,
    restore_signals,
    signal_received,
)
from puretf_tools.commands import web_view
from puretf_tools.commands.view_frames import format_tree
from puretf_tools.commands.web_view import main, read_into
from puretf_tools.doctor import Finding
from puretf_tools.doctor.explanation import explain
from puretf_tools.inspection.forest import Forest
from puretf_tools.view.feed import BagFeed

pytest.importorskip('viser')
from viewer import recorded, StubFeed

from puretf_tools.view.details import details
from puretf_tools.view.export import Animation
from puretf_tools.view.placement import FrameWatcher
from puretf_tools.view.view import Playback

S = 10**9
T = 1_700_000_000 * S


@pytest.fixture
def buffer():
    """A bag of 10 s, in which the frame base moves along x at 1 m/s."""
    buffer = TransformBuffer(10**18)
    for i in range(101):
        buffer.insert(T + i * S // 10, 'map', 'base', (i / 10, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    return buffer


class Controls:
    """The bar of a bag, and the clock of the bag."""

    def __init__(self, feed, clock):
        """Take a bag."""
        self._playback, self.feed, self._clock = Playback(feed), feed, clock
        self.act, self.player = self._playback.act, feed.player

    def after(self, seconds):
        """Update the bar when some time has passed; return the position in the bag (s)."""
        self._clock[0] += seconds
        assert self._playback.update(True) == self.player.time
        return self.player.position

    def shows(self, *names):
        """Return what the bar shows."""
        content = self._playback.content
        values = json.loads(content[content.index('>') + 1:content.rindex('<')])
        return values[names[0]] if len(names) == 1 else [values[name] for name in names]


@pytest.fixture
def controls(clock, buffer):
    """A function that creates the bar of the bag."""
    return lambda: Controls(BagFeed(buffer, 'robot.mcap'), clock)


def test_speed_pause_time_and_steps(controls):
    """A viewer changes each of them; a step goes to the next or last transform, and pauses."""
    shown = controls()
    assert shown.after(1.0) == 1.0
    shown.act('speed', '0.5')
    assert shown.after(1.0) == 1.5
    shown.act('pause', '')
    assert shown.after(1.0) == 1.5
    shown.act('seek', '3.02')
    assert shown.after(1.0) == 3.02
    shown.act('pause', '')
    shown.act('speed', '10')
    assert [shown.after(0.2), shown.after(0.1)] == pytest.approx([5.02, 6.02])
    shown.act('step', 'next')
    assert shown.after(0.0) == pytest.approx(6.1)
    assert shown.after(1.0) == pytest.approx(6.1)
    for _ in range(2):
        shown.act('step', 'back')
    assert shown.after(0.0) == pytest.approx(5.9)
    assert shown.shows('position', 'length', 'plays', 'speed', 'loops') == [
        5.9, 10.0, False, '10', True]


def test_what_cannot_be_done(controls):
    """It has no effect, whatever a viewer sends."""
    shown = controls()
    for action, what in (('speed', '1e9'), ('speed', 'nan'), ('seek', 'nan'), ('seek', 'inf'),
                         ('seek', ''), ('seek', 'x'), ('', ''), ('kept', 'copy view')):
        shown.act(action, what)
    assert shown.after(1.0) == 1.0
    shown.act('seek', '-1e9')
    assert shown.after(0.0) == 0.0


def test_a_bag_that_is_played_once(controls):
    """Without the loop, it ends; a step beyond the end goes nowhere."""
    shown = controls()
    shown.act('loop', '')
    assert [shown.after(12.0), shown.after(1.0)] == [10.0, 10.0]
    shown.act('step', 'next')
    assert shown.after(1.0) == 10.0


def test_the_keys_of_a_bag(page, buffer):
    """P pauses and plays on, B and N step; all keys are in the documentation, in this order."""
    feed = BagFeed(buffer, 'bag')
    shown = page(feed)
    section = (ROOT / 'docs' / 'web.md').read_text().split('\n## Keys\n')[1].split('\n## ')[0]
    assert ', '.join(re.findall(r'^\| ([A-Z, ]+) \|', section, re.M)) == ', '.join(
        props['hotkey'] for props in shown.viewer.gui.values() if 'hotkey' in props)
    for stamp in 95, 107:
        buffer.insert(T + stamp * S // 100, 'map', 'other', (0.0,) * 6 + (1.0,))
    feed.player.seek(T + 102 * S // 100)
    for key, position in ('B', 1.0), ('N', 1.07):
        shown.viewer.press(key)
        shown.until(lambda: feed.player.position == pytest.approx(position))  # noqa: B023
    for plays in True, False:
        shown.viewer.press('P')
        shown.until(lambda: feed.player.plays == plays)  # noqa: B023


def test_a_bag_waits_for_a_viewer(clock, buffer):
    """It starts when the first one comes."""
    playback = Playback(BagFeed(buffer, 'bag'))
    clock[0] += 3.0
    assert playback.update(False) == T
    clock[0] += 1.0
    assert playback.update(True) == T + S


def finding(code, time=0, frames=('base',), severity='warning'):
    """Return a finding."""
    return Finding(code, severity, frames, (), (), f'evidence <of> {code}', f'Mend {code}.',
                   'Other faults', time)


def test_the_findings_of_a_bag(page, clock, buffer):
    """Each is in the list and marks its rows; a click goes to its time, and pauses."""
    buffer.insert(T, 'map', 'other', (0.0,) * 6 + (1.0,), is_static=True)
    feed = BagFeed(buffer, 'bag')
    shown = page(feed)
    viewer = shown.viewer
    feed.verdict = '2 warnings'
    feed.findings = [
        finding('gap', T + 3 * S), finding('typo', T + 99 * S, ('other', 'map')),
        *(finding(f'late_{i}', T + 7 * S) for i in range(20))]
    shown.until(lambda: len(viewer.shown()['findings']) == 20)
    values = viewer.shown()
    assert (values['verdict'], values['more']) == ('2 warnings', 2)
    assert [each[:4] for each in values['findings'][:3]] == [
        ['warning', '+3.00 s: gap: base', 'evidence <of> gap.', 'Mend gap.'],
        ['warning', 'typo: other, map', 'evidence <of> typo.', 'Mend typo.'],
        ['warning', '+7.00 s: late_0: base', 'evidence <of> late_0.', 'Mend late_0.']]
    assert {name: marks for name, *_, marks in values['rows']} == {
        'map': [1], 'other': [1], 'base': [0, *range(2, 20)]}
    shown.until(lambda: viewer.shown('bar')['marks'] == [3.0, 7.0])
    viewer.act('finding', 'typo: other, map')
    shown.until(lambda: viewer.value('Frame') == 'other')
    viewer.act('finding', '+3.00 s: gap: base')
    shown.until(lambda: viewer.shown('bar')['position'] == 3.0
                and viewer.value('Frame') == 'base')
    clock[0] += 1.0
    shown.until(lambda: not viewer.shown('bar')['plays'])
    assert feed.player.position == 3.0
    feed.findings = [
        finding('many', frames=('base', *'abcdefghij'))._replace(since=clock[0] - 5.2),
        finding('gone')._replace(since=clock[0] - 9.0, over=clock[0] - 3.2)]
    shown.until(lambda: viewer.shown()['findings'][0][1] == 'many: base, a, b and 8 more')
    assert not any(marks for *_, marks in viewer.shown()['rows'])
    assert [each[4:] for each in viewer.shown()['findings']] == [
        ['since 5 s', False], ['over since 3 s', True]]


def test_a_bag_that_is_still_read(controls, buffer):
    """The player waits at the end of what has been read, and the panel says how far that is."""
    shown = controls()
    shown.feed.done, shown.player.is_whole = 0.4, False
    assert shown.after(12.0) == 10.0
    assert shown.after(1.0) == 10.0
    assert shown.shows('reading') == 'reading robot.mcap: 40 %'
    buffer.insert(T + 12 * S, 'map', 'base', (12.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert shown.after(1.0) == 11.0
    shown.feed.done = None
    assert shown.after(2.0) == 12.0
    assert shown.after(1.0) == 0.0
    assert shown.shows('reading', 'length') == ['', 12.0]


def test_a_bag_of_which_nothing_has_been_read(clock):
    """The player begins where the bag does, and goes on there if earlier stamps follow."""
    buffer = TransformBuffer(10**18)
    feed = BagFeed(buffer, 'bag')
    feed.done, feed.player.is_whole = 0.0, False
    clock[0] += 1.0
    feed.player.advance(True)
    pose = (0.0,) * 6 + (1.0,)
    for stamp, position in (T + S, 0.0), (T, 1.0):
        buffer.insert(stamp, 'map', 'base', pose)
        feed.update()
        assert (feed.player.time, feed.player.position) == (T + S, position)


def test_a_hole(buffer):
    """The details of a frame name the edge above it that has no data at the time shown."""
    buffer.insert(T + 14 * S, 'map', 'base', (14.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    buffer.insert(T, 'base', 'tool', (0.0,) * 6 + (1.0,), is_static=True)
    feed = BagFeed(buffer, 'bag')

    def text(seconds):
        feed.player.seek(T + seconds * S)
        placement = FrameWatcher(buffer).placement('map', feed.player.time)
        return details(placement, 'tool', feed, feed.buffer)

    assert 'interpolated' not in text(10)
    assert '>interpolated between +10.00 and +14.00 s: map -&gt; base has no data there<' in (
        text(12))
    assert 'interpolated' not in text(14)


def test_all_tools_have_one_rate(buffer):
    """It is the average, so a hole lowers it: 101 steps in 14 s."""
    buffer.insert(T + 14 * S, 'map', 'base', (14.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    placement = FrameWatcher(buffer).placement('map', T + 14 * S)
    page = details(placement, 'base', BagFeed(buffer, 'bag'), buffer)
    path = str(explain(buffer, ('map', 'base'), 0))
    for text in page, path, format_tree(Forest(buffer.frames()), 0)[1]:
        assert ' 7.2 Hz' in re.sub('[<>"]', ' ', text)
    assert '>average rate<' in page
    assert 'with the average rate' in path


def test_a_missing_part(bags, page, tmp_path):
    """The page says where it is, while a time in it is shown."""
    content = [*bags.walk(30)]
    files = [bags.file_of(bags.make(tmp_path / name, 'mcap', part)).rename(
        tmp_path / f'walk_{name}.mcap') for name, part in (
            ('0', content[:101]), ('2', content[201:]))]
    feed = BagFeed(TransformBuffer(10**18), 'bag')
    with bag.open(files) as opened:
        read_into(feed, opened)
    feed.update()
    shown = page(feed)
    # The first part ends with the transform at +9.9 s, the last one begins at +20 s.
    text = 'a part of the recording is missing or damaged between +9.90 and +20.00 s'
    for position, is_missing in (5.0, False), (15.0, True), (25.0, False):
        feed.player.stop_at(100 * S + round(position * S))
        shown.until(lambda: (text in shown.viewer.text('overview')) == is_missing)  # noqa: B023


@pytest.mark.parametrize(('text', 'position'), [
    (f'{T // S + 3}.25', 3.25), ('+4.5', 4.5), ('-1.5', 8.5), ('2023-11-14T22:13:26Z', 6.0),
    ('0', 10.0)])
def test_a_time_that_is_typed(controls, text, position):
    """It pauses, goes there, and the page shows the time in both forms."""
    shown = controls()
    shown.act('goto', text)
    assert [shown.after(1.0), shown.after(1.0)] == [position, position]
    stamp = f'{T // S + int(position)}.{position % 1:.9f}'.replace('.0.', '.')
    assert shown.shows('time', 'plays') == [f'+{position:g} s, {stamp}', False]


@pytest.mark.parametrize(('text', 'problem'), [
    ('+10.5', '+10.5 s, 1700000010.500000000 is outside of the bag, whose transforms are from '),
    ('soon', 'must be a time, such as '), ('<b>' * 999, '<b>')])
def test_a_time_that_is_not_in_the_bag(controls, text, problem):
    """The page says why, until there is another text, and the bag is played on."""
    shown = controls()
    shown.act('goto', text)
    assert shown.after(1.0) == 1.0
    assert problem in shown.shows('problem')
    assert len(shown.shows('problem')) < 2000
    shown.act('goto', '')
    assert shown.after(1.0) == 2.0
    assert not shown.shows('problem')


@pytest.fixture
def lonely(bags, tmp_path):
    """A function that reads a bag with descriptions of a robot in two namespaces."""
    text = bags.string('<robot name="r"><link name="lonely"/></robot>')
    path = bags.make(tmp_path, 'mcap', [
        *bags.walk(), ('/left/tf', 100 * S, [bags.row(100 * S, 'map', 'base')]),
        *((f'{each}/robot_description', 100 * S, text, bags.STRING) for each in ('', '/left'))])

    def read(namespace=''):
        feed = BagFeed(TransformBuffer(10**18), 'bag')
        with bag.open(path, namespace=namespace) as opened:
            read_into(feed, opened)
        return feed

    return read


@pytest.mark.parametrize(('namespace', 'expected'), [('left', {'/left'}), ('', {'', '/left'})])
def test_robots_of_a_bag(lonely, namespace, expected):
    """The page has the bodies of its namespace only, and the findings about them."""
    feed = lonely(namespace)
    assert {*map(feed.publication, feed.buffer.frames())} == {(None, 'not recorded')}
    assert {topic.removesuffix('/robot_description') for topic in feed.robots} == expected
    assert 'link_without_transform' in {each.code for each in feed.findings}


def test_a_bag_that_cannot_be_examined(lonely, monkeypatch):
    """The reason is a line of the findings."""
    monkeypatch.setattr(web_view, 'examine', lambda _: 1 / 0)
    assert lonely().verdict == 'tf_doctor cannot examine the bag: division by zero'


def test_the_first_camera_of_a_bag(page, buffer):
    """It shows the whole path."""
    shown = page(BagFeed(buffer, 'bag'))
    shown.until(lambda: shown.viewer.distance() > 17.0)
    assert shown.viewer.last['SetCameraLookAtMessage']['look_at'][0] > 4.0


@pytest.mark.parametrize('follow', ['', 'base'])
def test_the_camera_of_a_recording(buffer, follow):
    """It shows the whole path, or follows a frame, which then stays in the picture."""
    feed = BagFeed(buffer, 'bag')
    feed.follow = follow
    animation = Animation(feed)
    for second in range(11):
        animation.add(float(second), T + second * S)
    content = recorded(animation.as_html())['messages']
    sent = {kind: [message for _, message in content if message['type'] == kind] for kind in (
        'SetCameraPositionMessage', 'SetCameraLookAtMessage', 'SetPositionMessage')}
    distance = np.linalg.norm(np.subtract(sent['SetCameraPositionMessage'][-1]['position'],
                                          sent['SetCameraLookAtMessage'][-1]['look_at']))
    assert distance < 10.0 if follow else distance > 17.0
    world = [message['position'][0] for message in sent['SetPositionMessage']
             if message['name'] == '/world']
    assert world == ([-second for second in range(11)] if follow else [])


def test_a_recording(buffer):
    """It has the frames at each moment, and no controls."""
    animation = Animation(BagFeed(buffer, 'bag'))
    animation.add(5.0, T - 1)  # there is no frame yet
    assert not animation.moments
    for i in range(11):
        animation.add(5.0 + i / 2, T + i * S // 2)
    assert animation.duration == 5.0
    content = recorded(animation.as_html())
    assert content['durationSeconds'] == pytest.approx(5.05)
    assert not any(message['type'].startswith('Gui') for _, message in content['messages'])
    node = next(message['name'] for _, message in content['messages']
                if message.get('props', {}).get('text') == 'base')
    places = [(time, *message['position'][:1]) for time, message in content['messages']
              if message['type'] == 'SetPositionMessage' and message['name'] == node]
    assert places == [(i / 2, i / 2) for i in range(11)]
    camera = [time for time, message in content['messages']
              if message['type'] == 'SetCameraPositionMessage']
    assert camera == [0.0]


def test_ctrl_c_ends_a_live_recording(monkeypatch, buffer):
    """What was recorded is kept, and the command goes on to write it."""
    def add(animation, *args):
        original(animation, *args)
        if animation.duration > 0.0 and not signal_received():
            os.kill(os.getpid(), signal.SIGINT)

    original = Animation.add
    monkeypatch.setattr(Animation, 'add', add)
    handlers = record_signals()
    try:
        animation = Animation(StubFeed(buffer))
        animation.record(1e6)
        assert 0.0 < animation.duration < 1e6
        check_signals()
    finally:
        restore_signals(handlers)


def test_a_bag_without_frames_to_show(bags, failed, tmp_path):
    """It is an error, and no file is written."""
    bag = bags.make(tmp_path / 'bag', 'mcap', [
        ('/tf', T, [bags.row(T, 'a', 'b'), bags.row(T, 'b', 'a')])])
    path = tmp_path / 'loop.html'
    code, error = failed(main, '--bag', str(bag), '--export', str(path))
    assert code == 1
    assert error.startswith(f'web_view: cannot write {path}: there are no frames.')
    assert not path.exists()


def test_an_export_that_follows_nothing(bags, failed, tmp_path):
    """The name is told, and what is like it."""
    bag, path = bags.make(tmp_path / 'bag', 'mcap', bags.walk(1)), tmp_path / 'walk.html'
    code, error = failed(main, '--bag', str(bag), '--export', str(path), '--follow', 'base_lnik')
    assert (code, path.exists()) == (1, False)
    assert error == ("web_view: cannot follow 'base_lnik': there is no such frame. "
                     "Nearest known: 'base_link'.\n")


def test_an_export_of_a_bag(bags, capsys, tmp_path):
    """The file has all of the bag, or as many seconds as are asked for."""
    bag, path = bags.make(tmp_path / 'bag', 'mcap', bags.walk(4)), tmp_path / 'walk.html'
    for arguments, duration in ([], 4.0), (['--time', '1.5'], 1.5):
        assert main(['--bag', str(bag), '--export', str(path), *arguments]) == 0
        assert capsys.readouterr().out == f'wrote {path}: {duration} s\n'
        assert recorded(path.read_text())['durationSeconds'] == pytest.approx(duration + 0.05)
    assert {each.name for each in tmp_path.iterdir()} == {'bag', 'walk.html'}
