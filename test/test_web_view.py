"""The page of web_view in a real browser."""

from functools import partial
from math import degrees
from pathlib import Path
import signal
import socket

from browser import BrowserPage, chromium
from conftest import ARM, tool, tool_without_ros
from endings import without_library_lines
import imageio.v3 as iio
import numpy as np
import pytest

from dummy_arm.tf.rotations import euler_from_quaternion

S = 10**9
VIEW = tool('web_view')
FRAMES = 'map, base_link', 'joint_1', 'joint_2', 'joint_3', 'end_effector'


@pytest.fixture(scope='module')
def browser():
    """A browser that all tests share."""
    with chromium() as started:
        yield started


@pytest.fixture
def open_page(browser):
    """A function that opens the page of a process or an address; it must have no faults."""
    pages = []

    def open_url_of(process):
        url = process if isinstance(process, str) else url_of(process)
        pages.append(BrowserPage(browser.new_page(viewport={'width': 1000, 'height': 700}), url))
        return pages[-1]

    yield open_url_of
    for each in pages:
        each.page.close()
        assert each.hosts <= {'127.0.0.1', None}  # None: of data: and blob: URLs
        assert not each.faults


def url_of(process):
    """Return the address at which a process serves its page."""
    return process.line_with('look at http').split()[-1]


def test_the_waving_arm(start, ros, open_page, request, tmp_path):
    """Its frames appear, move, fade and return, and the numbers are those of a lookup."""
    from rclpy.duration import Duration

    from dummy_arm.tf import Buffer, TransformListener
    arm = start(*ARM)
    buffer = Buffer(Duration(seconds=60), ros.node)
    listener = TransformListener(buffer, ros.node)
    page = open_page(start(*VIEW))

    # The parts of the page change by separate messages, so not all at the same time.
    scene = page.until(lambda: (
        scene := page.scene_with(*FRAMES)).begins.shape == (4, 6, 3) and scene)
    map_, *_, joint_3, hand = map(scene.index, FRAMES)
    assert np.allclose(scene.begins[0, map_], 0.0)
    assert np.allclose(np.linalg.norm(scene.ends[:3] - scene.begins[:3], axis=2), 0.16)
    assert np.allclose(scene.ends[3, hand], scene.begins[0, joint_3], atol=1e-5)
    assert np.linalg.norm(scene.ends[3, hand] - scene.begins[3, hand]) == pytest.approx(0.2)
    assert np.allclose(scene.radii, [*[0.008] * 5, 0.0136])  # the selected frame stands out
    page.until(lambda: np.linalg.norm(
        page.scene().names['end_effector'] - scene.names['end_effector']) > 0.05)
    page.until(lambda: '6 frames' in page.overview())
    page.until(lambda: len(page.scene().trail) > 20)
    page.tick('Pause', True)
    page.click(middle_of_z_axis(page.scene(), 'joint_1'))
    page.until(lambda: page.value('parent') == 'base_link')
    page.choose('Frame', 'joint_2')
    page.until(lambda: page.value('parent') == 'joint_1')
    assert page.value('fixed') == 'map'
    assert page.value('publisher') == '/dummy_arm'
    for where in 'parent', 'fixed':
        assert_numbers_are_those_of_a_lookup(page, where, buffer)
    page.until(lambda: np.allclose(
        (scene := page.scene()).trail[-1, 1], scene.names['end_effector'], atol=0.05))
    picture = artefact(request, tmp_path, 'web_view.png')
    page.page.screenshot(path=picture)
    assert_arm_is_seen(iio.imread(picture))
    page.tick('Pause', False)
    page.until(lambda: page.value('rate').endswith(' Hz') and page.value('delay').endswith(' ms'))

    listener.unregister()
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


def middle_of_z_axis(scene, name):
    """Return the middle of the z axis of a frame (m)."""
    i = scene.index(name)
    return (scene.begins[2, i] + scene.ends[2, i]) / 2


def assert_numbers_are_those_of_a_lookup(page, where, buffer):
    """Compare the numbers of the paused panel with a lookup at the time that it shows."""
    from rclpy.time import Time
    seconds, nanoseconds = page.value(f'{where}-time').removesuffix(' s').split('.')
    transform = buffer.lookup_transform(
        page.value(where), 'joint_2', Time(seconds=int(seconds), nanoseconds=int(nanoseconds)))
    translation, rotation = transform.transform.translation, transform.transform.rotation
    quaternion = np.array([rotation.x, rotation.y, rotation.z, rotation.w])
    assert page.numbers(f'{where}-translation') == pytest.approx(
        [translation.x, translation.y, translation.z], abs=5.01e-4)
    shown = np.array(page.numbers(f'{where}-quaternion'))
    assert shown * np.sign(shown @ quaternion) == pytest.approx(quaternion, abs=5.01e-5)
    assert page.numbers(f'{where}-rpy') == pytest.approx(
        [*map(degrees, euler_from_quaternion(quaternion))], abs=5.01e-3)


def artefact(request, tmp_path, name):
    """Return the path of a file that is kept beside the results of the tests, if these are."""
    results = request.config.option.xmlpath
    return (Path(results).parent if results else tmp_path) / name


def assert_arm_is_seen(picture):
    """Assert that a picture is not blank, and has the colours of the axes."""
    red, green, blue = np.moveaxis(picture[..., :3].astype(int), -1, 0)
    left = np.arange(picture.shape[1]) < 0.6 * picture.shape[1]
    for one, *others in (red, green, blue), (green, red, blue), (blue, red, green):
        assert ((one > 60 + np.maximum(*others)) & left).sum() > 100
    assert len(np.unique(picture.reshape(-1, picture.shape[2]), axis=0)) > 500


def test_trees_that_change(start, ros, open_page):
    """All roots are shown; frames appear, and move when they get another parent."""
    from dummy_arm.tf import TransformBroadcaster
    broadcaster: TransformBroadcaster

    def send(*edges):
        for parent, child, x in edges:
            broadcaster.prepare([(parent, child)]).send(
                ros.node.get_clock().now(), [(x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)])

    robot = TransformBroadcaster(ros.node, tf_topic='/robot1/tf')
    edges = [('map', 'odom', 1.0), ('map', 'left', 3.0), ('odom', 'base', 0.5)]
    page = open_page(start(*VIEW))
    page.scene_with()
    until = partial(page.until, pause=partial(ros.executor.spin_once, timeout_sec=0.05))
    until(lambda: '/robot1/tf has 1 publisher: --namespace robot1' in page.overview())
    ros.node.destroy_publisher(robot.pub_tf)
    broadcaster = TransformBroadcaster(ros.node)
    ros.node.create_timer(0.02, lambda: send(*edges))

    def scene_with(*names, at=None):
        def there():
            scene = page.scene()
            is_there = scene.names.keys() >= {*names} and (
                at is None or np.allclose(scene.names[names[0]], at))
            return is_there and scene

        return until(there)

    scene = scene_with('map', 'odom', 'left', 'base')
    assert np.allclose(scene.names['base'], (1.5, 0.0, 0.0))
    edges += [('world', '<b>tree</b>', 1.0)]
    scene = scene_with('world', '<b>tree</b>')
    assert np.allclose(scene.names['<b>tree</b>'], (1.0, -2.0, 0.0))
    until(lambda: 'not connected to map: world' in page.overview())
    page.choose('Frame', '<b>tree</b>')
    until(lambda: page.value('parent') == 'world')
    assert page.numbers('parent-translation') == [1.0, 0.0, 0.0]
    assert not page.page.query_selector('[data-value=fixed]')  # its numbers would be equal
    edges[2] = 'left', 'base', 0.5
    scene = scene_with('base', at=(3.5, 0.0, 0.0))
    base, left = map(scene.index, ('base', 'left'))
    assert np.allclose(scene.ends[3, base], scene.begins[0, left], atol=1e-5)
    page.choose('Fixed frame', 'left')
    scene_with('map', at=(-3.0, 0.0, 0.0))
    page.tick('Show names', False)
    until(lambda: not page.scene().names)


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


@pytest.mark.soak
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


def test_a_failed_wait_describes_the_page(start, open_page, tmp_path):
    """The message shows what the page had, so that the failure can be understood."""
    bags = pytest.importorskip('bags')
    path = bags.make(tmp_path / 'bag', 'mcap', bags.walk())
    page = open_page(start(*tool_without_ros('web_view', '--bag', str(path))))
    page.scene_with('map', 'odom', 'base_link')
    page.until(lambda: 'pose in the parent odom' in page.description())
    page.faults.append('a fault')
    with pytest.raises(AssertionError, match=(
            r"(?s)waited in vain; faults: \['a fault'\]\noverview:\nbag: 3 frames\ndetails:\n"
            r'.*pose in the parent odom.*names: .*odom at \[1, 2, 3\]')):
        page.until(lambda: False, timeout=0.0)
    page.faults.clear()


@pytest.mark.soak
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
