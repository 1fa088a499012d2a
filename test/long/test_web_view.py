"""The page of web_view in a real browser, when frames, pages and servers come and go."""

import signal
import socket

from browser import pages
from endings import without_library_lines
import numpy as np
from processes import ARM, tool, tool_without_ros
import pytest

S = 10**9
VIEW = tool('web_view')
FRAMES = 'map, base_link', 'joint_1', 'joint_2', 'joint_3', 'end_effector'


@pytest.fixture
def open_page():
    """A function that opens the page of a process or an address; it must have no faults."""
    with pages() as open_url:
        yield lambda process: open_url(process if isinstance(process, str) else url_of(process))


def url_of(process):
    """Return the address at which a process serves its page."""
    return process.line_with('look at http').split()[-1]


def test_frames_that_fade_and_return(start, open_page):
    """They turn grey, get thin, and vanish with their names and the trail."""
    arm = start(*ARM)
    page = open_page(start(*VIEW))
    hand = page.scene_with(*FRAMES).index('end_effector')
    page.until(lambda: len(page.scene().trail) > 20)
    page.choose('Frame', 'joint_2')
    page.until(lambda: page.value('parent') == 'joint_1')
    arm.end(signal.SIGINT)
    grey = page.until(lambda: (scene := page.scene()).radii[hand] < 0.007 and scene)
    assert np.ptp(grey.colours[0, hand]) < 0.02
    page.until(lambda: page.value('rate').startswith('no update for'))
    gone = page.until(lambda: (scene := page.scene()).radii[hand] == 0.0 and scene)
    assert np.allclose(gone.radii, [0.008, 0.008, 0.0, 0.0, 0.0, 0.0])
    page.until(lambda: (scene := page.scene()).names.keys() == {'map, base_link'}
               and not len(scene.trail))
    page.until(lambda: '2 frames\nnot shown, because no new transform has arrived for 15 s on the '
               'path to: joint_1, joint_2, joint_3, end_effector' in page.overview())
    start(*ARM)
    back = page.until(lambda: np.allclose(  # with joint_2 selected
        (scene := page.scene_with(*FRAMES)).radii, [0.008, 0.008, 0.008, 0.0136, 0.008, 0.008]
    ) and scene)
    assert back.colours[0, hand, 0] > 0.7


def test_a_bag_without_ros(start, open_page, tmp_path):
    """The bag is played and stops at a chosen time; many names are hidden at first."""
    bags = pytest.importorskip('bags')
    posts = [bags.row(100 * S, 'map', f'post_{i}', (0, i, 0, 0, 0, 0, 1)) for i in range(1, 61)]
    path = bags.make(tmp_path / 'bag', 'mcap', [*bags.walk(), ('/tf_static', 100 * S, posts)])
    process = start(*tool_without_ros('web_view', '--bag', str(path)))
    page = open_page(process)
    page.until(lambda: '63 frames' in page.overview())
    assert not page.scene().names
    page.tick('Show names', True)
    page.tick('Pause', True)
    page.scene_with('map', 'odom', 'base_link', 'post_59')
    slider = page.page.get_by_role('slider').first
    for key, x in ('End', 11.0), ('Home', 1.0):
        slider.press(key)
        page.until(lambda x=x: np.allclose(page.scene().names['base_link'], (x, 2.0, 3.0)))
    page.tick('Pause', False)
    page.until(lambda: page.scene().names['base_link'][0] > 1.5)
    assert page.value('publisher') == 'not recorded'
    page.until(lambda: page.value('rate') == '10.0 Hz')
    process.end(signal.SIGINT)
    assert process.exit_code() == 0
    page.faults.clear()  # the page cannot connect any more


def test_a_frame_that_is_far(start, open_page, tmp_path):
    """It is drawn nearer and listed, and the panel shows its real numbers."""
    bags = pytest.importorskip('bags')
    far = [bags.row(100 * S, 'map', 'far', (3e9, -4e9, 0, 0, 0, 0, 1)),
           bags.row(100 * S, 'map', 'farther', (0, 1e30, 0, 0, 0, 0, 1))]
    path = bags.make(tmp_path / 'bag', 'mcap', [*bags.walk(), ('/tf_static', 100 * S, far)])
    page = open_page(start(*tool_without_ros('web_view', '--bag', str(path))))
    scene = page.scene_with('map', 'far', 'farther', 'base_link')
    assert np.allclose(scene.names['far'], (6e5, -8e5, 0.0))
    assert np.allclose(scene.names['farther'], (0.0, 1e6, 0.0))
    assert 'more than 1,000,000 m away, drawn at that distance: far, farther' in page.overview()
    page.choose('Frame', 'far')
    page.until(lambda: page.numbers('parent-translation') == [3e9, -4e9, 0.0])


def test_several_viewers_on_the_next_free_port(start, open_page):
    """Closing or reloading one of two pages, or ending one of two servers, harms no other."""
    start(*ARM)
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            taken.bind(('127.0.0.1', 8080))
            taken.listen()
            used = {'http://127.0.0.1:8080'}
        except OSError:  # another process uses the port, which will do as well
            used = set()
        views = [start(*VIEW), start(*VIEW)]
        urls = [url_of(view) for view in views]
    assert len({*urls, *used}) == 2 + len(used)
    first, second = open_page(urls[0]), open_page(urls[0])
    first.scene_with(*FRAMES)
    first.page.close()
    second.scene_with(*FRAMES)
    second.page.reload()
    second.scene_with(*FRAMES)
    for view, signal_number in zip(views, (signal.SIGINT, signal.SIGTERM)):
        view.end(signal_number)
        assert view.exit_code() == 0
        assert without_library_lines(view.output) == f'look at {urls[views.index(view)]}\n'
    second.faults.clear()  # the page cannot connect any more
