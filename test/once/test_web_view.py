"""The page of web_view in a real browser: the body of the arm, and a file without a server."""

from math import pi
import time

import imageio.v3 as iio
import numpy as np
from processes import ARM, tool
import pytest
from ros_node import stamped

from puretf import TransformBroadcaster

pytest.importorskip('urdf_parser_py', reason='urdf_parser_py, which parses URDF, is missing')
from browser import pages

FRAMES = 'map, base_link', 'joint_1', 'joint_2', 'joint_3', 'end_effector'


def test_the_body_of_the_arm_in_a_browser(start, tmp_path):
    """Its links are drawn at their frames, and move; the checkbox hides them."""
    start(*ARM)
    view = start(*tool('web_view'))
    with pages() as open_url:
        page = open_url(view.line_with('look at http').split()[-1])
        look_at_the_body(page, tmp_path / 'body.png')


def look_at_the_body(page, picture):
    """Look where the links are, and at the colours of the page."""
    scene = page.until(lambda: len((scene := page.scene_with(*FRAMES)).bodies) == 5 and scene)
    hand = scene.bodies[-1]
    page.until(lambda: np.linalg.norm(page.scene().bodies[-1] - hand) > 0.05)
    page.tick('Pause', True)

    def stand_at_frames():
        scene = page.scene()
        return len(scene.bodies) == 5 and all(
            np.linalg.norm(scene.begins[0] - body, axis=1).min() < 1e-4 for body in scene.bodies)

    page.until(stand_at_frames)
    page.open_tab('Display')
    page.tick('Lines to parents', False)  # they are orange, too
    page.open_tab('Robot')
    page.until(lambda: 'dummy_arm on /robot_description: 5 of 5 links have a frame' in
               page.page.inner_text('[data-text="robot"]'))

    def orange():
        """Return the number of orange pixels, as the beams have, below the warning of viser."""
        page.page.screenshot(path=picture)
        red, green, blue = np.moveaxis(iio.imread(picture)[200:, :, :3].astype(int), -1, 0)
        return ((red > 150) & (red - green > 60) & (green - blue > 30)).sum()

    page.until(lambda: orange() > 300)
    page.tick('Visual', False)
    page.until(lambda: not len(page.scene().bodies) and orange() < 30)


#: After each picture: the largest distance from a body to the next axes (m), and where a body is.
PICTURES = """() => {
    const nodes = window.__viserMutable.nodeRefFromName;
    const length = window.__viserSceneTree.getState()['/world/frames'].message.props.axes_length;
    let root = nodes['/world/frames'];
    while (root.parent) root = root.parent;
    const matrix = root.matrix.clone(), place = root.position.clone();
    window.pictures = [];
    root.onAfterRender = () => {
        let mesh = null;
        nodes['/world/frames'].traverse(o => { if (o.isInstancedMesh && !mesh) mesh = o; });
        const frames = [];
        for (let i = 0; i < mesh.count; i += 3) {
            mesh.getMatrixAt(i, matrix);
            const e = matrix.elements, begin = k => e[12 + k] - e[4 + k] * length / 2;
            frames.push(place.clone().set(begin(0), begin(1), begin(2)));
        }
        const bodies = Object.keys(nodes).filter(key => /^\\/world\\/robots\\/\\d+$/.test(key));
        window.pictures.push([Math.max(...bodies.map(key => Math.min(
            ...frames.map(frame => frame.distanceTo(nodes[key].position))))),
            ...nodes[bodies.at(-1)].position.toArray()]);
    };
}"""


def test_axes_and_bodies_are_drawn_together(start):
    """In each picture of a slow browser, all are from the same update."""
    start(*ARM)
    view = start(*tool('web_view'))
    with pages() as open_url:
        page = open_url(view.line_with('look at http').split()[-1], 1600, 1200)
        page.until(lambda: len(page.scene_with(*FRAMES).bodies) == 5)
        page.page.evaluate(PICTURES)
        page.until(lambda: page.page.evaluate('window.pictures.length') >= 30)
        apart, *place = np.array(page.page.evaluate('window.pictures')).T
    moves = np.linalg.norm(np.diff(place, axis=1), axis=0)
    assert moves.max() > 0.01
    assert np.median(apart) < 1e-3
    assert np.mean(apart < 1e-3) > 0.8


def test_a_file_that_plays_without_a_server(start, tmp_path):
    """It shows the live arm move, and asks no host."""
    start(*ARM)
    path = tmp_path / 'arm.html'
    process = start(*tool('web_view', '--export', str(path), '--time', '4'))
    assert process.line().startswith(f'wrote {path}: ')
    assert process.exit_code() == 0
    with pages() as open_url:
        page = open_url(path.as_uri())
        scene = page.until(lambda: (
            scene := page.scene_with(*FRAMES)).begins.shape == (3, 6, 3) and scene)
        hand = 'end_effector'
        page.until(lambda: np.linalg.norm(
            page.scene_with(hand).names[hand] - scene.names[hand]) > 0.05)
        page.until(lambda: len(page.scene().trail) > 20)
        page.until(lambda: len(page.scene().bodies) == 5)
        page.page.screenshot(path=tmp_path / 'web_view_export.png')
        assert page.hosts <= {None, ''}


def test_a_time_of_a_bag_in_a_browser(start, tmp_path):
    """It is typed, the frames are those of this time, and the page says what is wrong with it."""
    bags = pytest.importorskip('bags')
    bag = bags.make(tmp_path / 'walk', 'mcap', bags.walk())
    view = start(*tool('web_view', '--bag', str(bag)))
    with pages() as open_url:
        page = open_url(view.line_with('look at http').split()[-1])
        page.until(lambda: page.value('fixed') == 'map')
        page.fill('Go to', '+3.5')
        page.until(lambda: page.value('fixed-time') == '+3.5 s, 103.500000000')
        assert page.page.inner_text('[data-text="time"]') == '+3.5 s, 103.500000000'
        assert page.numbers('fixed-translation') == [4.5, 2.0, 3.0]
        page.fill('Go to', '3.5')
        page.until(lambda: page.page.inner_text('[data-text="problem"]').endswith(
            'outside of the bag, whose transforms are from 100.000000000 to +10 s, 110.000000000'))
        page.page.screenshot(path=tmp_path / 'web_view_bag.png')


def test_time_that_goes_back_in_a_browser(ros, start, tmp_path):
    """The page begins again by itself if a publisher goes back, or by the button Reset."""
    offsets, broadcaster = {'hand': 0.0, 'tool': 0.0}, TransformBroadcaster(ros.node)

    def send():
        now = time.monotonic()
        broadcaster.sendTransform([
            stamped('map', frame, 10**18 + round((now + offset) * 1e9), 2.0 * i + np.sin(now))
            for i, (frame, offset) in enumerate(offsets.items())])

    ros.node.create_timer(0.02, send)
    view = start(*tool('web_view'), domain=ros.domain)
    with ros.spinning(), pages() as open_url:
        page = open_url(view.line_with('look at http').split()[-1])

        def moves():
            before = page.scene_with('hand', 'tool').names
            page.until(lambda: all(np.linalg.norm(
                page.scene().names[frame] - before[frame]) > 0.1 for frame in ('hand', 'tool')))

        moves()
        offsets.update(hand=-130.0, tool=-130.0)
        cause = 'transforms arrive from /test, but their time went back by 130 s'
        page.until(lambda: cause in page.overview())
        page.page.screenshot(path=tmp_path / 'time_went_back.png')
        moves()
        page.until(lambda: 'went back' not in page.overview())
        offsets['tool'] = -160.0  # only a part of what the node publishes
        page.until(lambda: 'their time went back by 30 s' in page.overview())
        page.button('Reset')
        moves()


def test_the_tabs_in_a_browser(ros, listening, start, tmp_path):
    """A viewer uses each tab, on a wide screen and on a narrow one."""
    start(*ARM)
    view = start(*tool('web_view'))
    with pages() as open_url:
        page = open_url(view.line_with('look at http').split()[-1], 1000, 700)
        for width, height, frames, joint_1, new in (
                (1000, 700, 6, 'joint_1', 'camera'), (390, 800, 7, 'joint_1, camera', 'lamp')):
            page.page.set_viewport_size({'width': width, 'height': height})
            page.open_tab('Display')
            page.tick('Axes', True)
            page.scene_with('end_effector')
            page.open_tab('Tree')
            count = f'{frames} of {frames} frames'
            page.until(lambda: count in page.page.inner_text('[data-text="tree"]'))  # noqa: B023
            page.button('joint_2')
            selected = page.page.get_by_role('button').filter(has_text='◀')
            page.until(lambda: selected.filter(has_text='joint_2').count())  # noqa: B023
            page.tick('Show its branch', False)
            page.until(lambda: page.scene().names.keys() == {'map, base_link', joint_1})  # noqa: B023
            page.tick('Show its branch', True)
            page.fill('Exclude', '^joint|camera')
            page.until(lambda: page.scene().names.keys() == {'map, base_link', 'end_effector'})
            page.fill('Exclude', '')
            page.open_tab('Display')
            page.tick('Axes', False)
            page.until(lambda: not page.scene().lengths.any())
            page.open_tab('Pair')
            page.choose('A', 'joint_2')
            page.choose('B', 'joint_3')
            page.until(lambda: page.page.locator('[data-text="pair"]').count())
            page.until(lambda: page.page.locator('canvas').count() >= 3)  # the scene and two plots
            page.page.screenshot(path=tmp_path / f'web_view_{width}.png')
            page.open_tab('By hand')
            # The page unticks the box when the name changes: on a slow machine, after a while.
            page.tick('Publish', False)
            page.fill('New frame', new)
            page.until(lambda: f'id {new}' in command(page))  # noqa: B023
            page.choose('Parent', 'joint_1')
            page.until(lambda: 'frame-id joint_1' in command(page))
            page.tick('Publish', True)
            ros.until(lambda: new in listening.frame_names())  # noqa: B023
            page.open_tab('Frame')
            page.choose('Frame', new)
            page.until(lambda: page.value('publisher') == '/web_view')
            move_the_arm(page, ros, listening)


def command(page):
    """Return the command that publishes the frame that is placed by hand."""
    return page.page.inner_text('[data-text="command"]')


def move_the_arm(page, ros, buffer):
    """Type a number beside a slider, and drag it: the frames of the arm move."""
    from rclpy.time import Time
    page.open_tab('Robot')

    def angle():
        rotation = buffer.lookup_transform('base_link', 'joint_1', Time()).transform.rotation
        return 2.0 * np.arctan2(rotation.z, rotation.w)

    # Behind the label come a hidden field, the handle and the field with the number.
    behind = '//label[.="joint_1 (°)"]/following::'
    page.page.locator(f'xpath={behind}input[2]').fill('30')
    ros.until(lambda: angle() == pytest.approx(pi / 6))
    page.button('Centre')
    ros.until(lambda: angle() == 0.0)
    box = page.page.locator(f'xpath={behind}*[@role="slider"][1]').bounding_box()
    mouse = page.page.mouse
    mouse.move(box['x'] + box['width'] / 2, box['y'] + box['height'] / 2)
    mouse.down()
    mouse.move(box['x'] + 500, box['y'])
    mouse.up()
    ros.until(lambda: angle() == pytest.approx(pi / 4))
    page.button('Wave')
    ros.until(lambda: angle() < 0.0)
