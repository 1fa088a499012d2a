"""The page of web_view: as a process, and in a real browser."""

from math import degrees
from pathlib import Path
import signal
import socket
from urllib.request import urlopen

import numpy as np
from processes import ARM, TIMEOUT, tool, tool_without, tool_without_ros
import pytest

from puretf.rotations import euler_from_quaternion

#: Frames whose names do not cover each other for long, whatever the arm does.
FRAMES = 'map, base_link', 'joint_1', 'end_effector'


def test_a_port_that_is_given(start, ros, monkeypatch):
    """The page is served there, whatever viser's environment variables are."""
    from viewer import Viewer

    from puretf import TransformBroadcaster
    monkeypatch.setenv('_VISER_PORT_OVERRIDE', '1')
    with socket.create_server(('127.0.0.1', 0)) as found:
        port = found.getsockname()[1]
    process = start(*tool('web_view', '--port', str(port)))
    assert process.line() == f'look at http://127.0.0.1:{port}\n'
    with urlopen(f'http://127.0.0.1:{port}', timeout=TIMEOUT) as answer:
        assert answer.status == 200
    robot = TransformBroadcaster(ros.node, tf_topic='/robot1/tf')
    viewer = Viewer(port)
    hint = f'To listen to {robot.pub_tf.topic_name}, pass '
    viewer.until(lambda: hint in viewer.text('overview'))
    viewer.close()
    process.end_normally(signal.SIGTERM)


#: Code before that of `tool`: from 105 s on, a bag is read slowly, until there is a file `go`.
SLOWLY = """
from pathlib import Path
from time import sleep
from puretf_tools.doctor.observation import BagObserver

def add(self, message, add=BagObserver.add):
    if message.time >= 105 * 10**9 and not Path("go").exists():
        sleep(0.15)
    add(self, message)

BagObserver.add = add
"""


@pytest.fixture
def slowly(start, tmp_path):
    """A function that starts the page of a bag of 1000 s, of which little has been read."""
    bags = pytest.importorskip('bags')
    from viewer import Viewer
    bag = bags.make(tmp_path / 'robot', 'mcap', bags.walk(1000, 1))
    viewers = []

    def start_page():
        flag, code, *arguments = tool_without_ros('web_view', '--bag', str(bag))
        process = start(flag, SLOWLY + code, *arguments, cwd=tmp_path)
        viewers.append(Viewer(process.port()))
        return process, viewers[-1]

    yield start_page
    for viewer in viewers:
        viewer.close()


def test_a_bag_is_shown_while_it_is_read(slowly, tmp_path):
    """Its transforms appear at once, without ROS; its length, findings and all its time follow."""
    _, viewer = slowly()
    viewer.until(lambda: '3 frames' in viewer.shown().get('status', ()))
    viewer.until(lambda: 'reading robot: ' in viewer.shown('bar').get('reading', ''))
    viewer.until(lambda: viewer.shown('bar')['length'] < 1000.0)
    (tmp_path / 'go').touch()
    viewer.until(lambda: 'transforms of 3 frames' in viewer.shown()['verdict'])
    viewer.until(lambda: not viewer.shown('bar')['reading'])
    viewer.until(lambda: viewer.shown('bar')['length'] == 1000.0)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=str)
def test_a_signal_while_a_bag_is_read(slowly, number):
    """The command ends, and does not wait for the bag, which would take minutes."""
    process, viewer = slowly()
    viewer.until(lambda: 'reading robot: ' in viewer.shown('bar').get('reading', ''))
    process.end(number)
    assert process.exit_code() == 0
    assert process.output.count('\n') == 1


@pytest.mark.parametrize(('kind', 'error'), [
    ('cut', 'cannot be read: '), ('other', 'has no TF: '),
    ('rosbags', 'pip install rosbags')])
def test_a_bag_that_cannot_be_read(start, tmp_path, kind, error):
    """The command ends with an error in one line, although the page may be served already."""
    bags = pytest.importorskip('bags')
    path = bags.file_of(bags.make(tmp_path / 'robot', 'mcap', [
        *(bags.walk() if kind != 'other' else ()),
        ('/text', 100 * bags.S, bags.string('x'), bags.STRING)]))
    if kind == 'cut':
        path.write_bytes(path.read_bytes()[:-1000])
    process = start(*tool_without(['rosbags'] * (kind == 'rosbags'), 'web_view', '--bag',
                                  str(path)))
    assert process.exit_code() == 1
    *served, line = process.output.splitlines()
    assert [each[:12] for each in served] == ['look at http'] * (kind != 'rosbags')
    assert line.startswith('web_view: ')
    assert error in line


@pytest.mark.parametrize(('name', 'kind'), [
    ('web_view', 'mcap'), ('tf_doctor', 'db3'), ('tf_doctor', 'bag')])
def test_a_bag_is_read_once(start, tmp_path, kind, name):
    """Each byte of it, whatever the command shows of it."""
    bags = pytest.importorskip('bags')
    from viewer import Viewer

    def read(messages, number):
        path = bags.make(tmp_path / number, kind, messages)
        flag, code, *rest = tool_without_ros(name, '--bag', str(path))
        process = start(flag, 'import atexit; from pathlib import Path; atexit.register('
                        'lambda: print(Path("/proc/self/io").read_text()));' + code, *rest)
        if name == 'web_view':
            viewer = Viewer(process.port())
            viewer.until(lambda: 'healthy' in viewer.shown().get('verdict', ''))
            viewer.close()
            process.end(signal.SIGINT)
        size = sum(file.stat().st_size for file in [path, *path.rglob('*')] if file.is_file())
        return int(process.line_with('rchar').split()[1]), size

    def messages(count):
        for time in range(100 * bags.S, 100 * bags.S + count * 10**7, 10**7):
            yield '/tf', time, [bags.row(time, 'map', f'frame_{i}') for i in range(20)]
            yield '/point', time, point + bytes(2000), 'geometry_msgs/msg/PointStamped'

    point = bags.point('map', 100 * bags.S, 1 if kind == 'bag' else 2)
    small, _ = read(messages(100), 'small')
    large, size = read(messages(1500), 'large')
    assert size > 5e6
    assert size * 0.8 < large - small < size * 1.2


def test_the_waving_arm_in_a_browser(ros, start, browse, request, tmp_path):
    """Its frames appear and move, and the numbers are those of a lookup."""
    import imageio.v3 as iio
    from rclpy.duration import Duration

    from puretf import Buffer, TransformListener
    buffer = Buffer(Duration(seconds=600), ros.node)
    listener = TransformListener(buffer, ros.node)
    start(*ARM)
    page = browse(start(*tool('web_view')))

    # A picture in which names are drawn one picture later than the axes is left out.
    scene = page.until(lambda: (scene := page.scene_with(*FRAMES)).begins.shape == (3, 6, 3)
                       and scene.is_together() and scene)
    map_, _, hand = map(scene.index, FRAMES)
    assert np.allclose(scene.begins[0, map_], 0.0)
    # The selected frame stands out.
    assert np.allclose(scene.lengths, [*[0.16] * 5, 0.24], atol=1e-4)
    line, = [each for each in scene.lines
             if np.allclose(each[0], scene.begins[0, hand], atol=1e-4)]
    assert np.abs(scene.begins[0] - line[1]).max(axis=1).min() < 1e-4  # joint_3
    assert np.linalg.norm(line[1] - line[0]) == pytest.approx(0.2, abs=2e-4)
    page.until(lambda: np.linalg.norm(
        page.scene().names['end_effector'] - scene.names['end_effector']) > 0.05)
    page.until(lambda: '6 frames' in page.page.inner_text('#tf-status'))
    page.until(lambda: len(page.scene().trail) > 20)
    page.button('pause')
    page.click('joint_1', lambda: page.value('parent') == 'base_link')
    page.choose('Frame', 'joint_2')
    page.until(lambda: page.value('parent') == 'joint_1')
    assert page.value('fixed') == 'map'
    assert page.value('publisher') == '/dummy_arm'
    assert_numbers_are_those_of_a_lookup(page, buffer)
    page.until(lambda: np.allclose(
        (scene := page.scene()).trail[-1, 1], scene.names['end_effector'], atol=0.05))
    results = request.config.option.xmlpath  # the picture is kept beside those of the tests
    picture = (Path(results).parent if results else tmp_path) / 'web_view.png'
    page.page.screenshot(path=picture)
    assert_arm_is_seen(iio.imread(picture))
    page.button('resume')
    page.until(lambda: page.value('rate').endswith(' Hz') and page.value('delay').endswith(' ms'))
    listener.unregister()


def assert_numbers_are_those_of_a_lookup(page, buffer):
    """Compare the pose in the fixed frame, which is paused, with a lookup at its time."""
    from rclpy.time import Time
    seconds, nanoseconds = page.page.get_attribute(
        '[data-value="fixed-time"]', 'title').removesuffix(' s').split('.')
    transform = buffer.lookup_transform(
        page.value('fixed'), 'joint_2', Time(seconds=int(seconds), nanoseconds=int(nanoseconds)))
    translation, rotation = transform.transform.translation, transform.transform.rotation
    quaternion = np.array([rotation.x, rotation.y, rotation.z, rotation.w])
    assert page.numbers('fixed-translation') == pytest.approx(
        [translation.x, translation.y, translation.z], abs=5.01e-4)
    shown = np.array(page.numbers('fixed-quaternion'))
    assert shown * np.sign(shown @ quaternion) == pytest.approx(quaternion, abs=5.01e-5)
    assert page.numbers('fixed-rpy') == pytest.approx(
        [*map(degrees, euler_from_quaternion(quaternion))], abs=5.01e-3)


def assert_arm_is_seen(picture):
    """Assert that a picture is not blank, and has the colours of the axes."""
    red, green, blue = np.moveaxis(picture[..., :3].astype(int), -1, 0)
    scene = abs(np.arange(picture.shape[1]) / picture.shape[1] - 0.5) < 0.25  # not the panels
    for one, *others in (red, green, blue), (green, red, blue), (blue, red, green):
        assert ((one > 60 + np.maximum(*others)) & scene).sum() > 30
    assert len(np.unique(picture.reshape(-1, picture.shape[2]), axis=0)) > 500
