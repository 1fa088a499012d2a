"""The page of web_view in a real browser: the body of the arm, and a file without a server."""

import json
from math import pi
from pathlib import Path
from shutil import copytree
import socket
import time

import imageio.v3 as iio
import numpy as np
from processes import ARM, tool
import pytest
from ros_node import stamped

from puretf import TransformBroadcaster

#: Frames whose names do not cover each other for long, whatever the arm does.
FRAMES = 'map, base_link', 'joint_1', 'end_effector'


def test_the_body_of_the_arm_in_a_browser(start, browse, tmp_path):
    """Its links are drawn at their frames, and move; the checkbox hides them."""
    start(*ARM)
    view = start(*tool('web_view'))
    page, picture = browse(view), tmp_path / 'body.png'
    scene = page.until(lambda: len((scene := page.scene_with(*FRAMES)).bodies) == 5 and scene)
    hand = scene.bodies[-1]
    page.until(lambda: np.linalg.norm(page.scene().bodies[-1] - hand) > 0.05)

    def orange():
        """Return the number of orange pixels, as the beams have, below the warning of viser."""
        page.page.screenshot(path=picture)
        red, green, blue = np.moveaxis(iio.imread(picture)[200:, :, :3].astype(int), -1, 0)
        return ((red > 150) & (red - green > 60) & (green - blue > 30)).sum()

    # While it moves: it may stand so that the beams point at the camera.
    page.until(lambda: orange() > 300)
    page.button('pause')

    def stand_at_frames():
        scene = page.scene()
        return len(scene.bodies) == 5 and all(
            np.linalg.norm(scene.begins[0] - body, axis=1).min() < 1e-4 for body in scene.bodies)

    page.until(stand_at_frames)
    page.open_tab('Robot')
    page.until(lambda: 'dummy_arm on /robot_description: 5 of 5 links have a frame' in
               page.page.inner_text('[data-text="robot"]'))
    page.open_tab('Display')
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


def test_axes_and_bodies_are_drawn_together(start, browse):
    """In each picture of a slow browser, all are from the same update."""
    start(*ARM)
    view = start(*tool('web_view'))
    page = browse(view, 1600, 1200)
    page.until(lambda: len(page.scene_with(*FRAMES).bodies) == 5)
    page.page.evaluate(PICTURES)
    page.until(lambda: page.page.evaluate('window.pictures.length') >= 30)
    apart, *place = np.array(page.page.evaluate('window.pictures')).T
    moves = np.linalg.norm(np.diff(place, axis=1), axis=0)
    assert moves.max() > 0.01
    assert np.median(apart) < 1e-3
    assert np.mean(apart < 1e-3) > 0.8


def test_a_file_that_plays_without_a_server(start, browse, tmp_path):
    """It shows the live arm move, and asks no host."""
    start(*ARM)
    path = tmp_path / 'arm.html'
    process = start(*tool('web_view', '--export', str(path), '--time', '4'))
    assert process.line().startswith(f'wrote {path}: ')
    assert process.exit_code() == 0
    page = browse(path.as_uri())
    scene = page.until(lambda: (
        scene := page.scene_with(*FRAMES)).begins.shape == (3, 6, 3) and scene)
    hand = 'end_effector'
    page.until(lambda: np.linalg.norm(
        page.scene_with(hand).names[hand] - scene.names[hand]) > 0.05)
    page.until(lambda: len(page.scene().trail) > 20)
    page.until(lambda: len(page.scene().bodies) == 5)
    page.page.screenshot(path=tmp_path / 'web_view_export.png')
    assert page.hosts <= {None, ''}
    assert page.page.title() == 'TF: /tf and /tf_static'


#: A robot of 30 frames, whose names are below each other.
LINKS = tuple(f'link_{i:02}' for i in range(30))


class Robot:
    """Publishes the frames of a robot with faults: a misspelt parent, and a second publisher."""

    def __init__(self, ros):
        """Publish at 20 Hz, from two nodes."""
        from rclpy import create_node
        self.first = TransformBroadcaster(ros.node)
        self.node = create_node('second', context=ros.context)
        self.second = TransformBroadcaster(self.node)
        ros.node.create_timer(0.05, self.send)

    def send(self):
        """Send all transforms."""
        now = time.time_ns()
        self.first.sendTransform([
            stamped('map', 'base_link', now, 0.0), stamped('base_lnk', 'laser', now, 1.0),
            *(stamped('base_link', name, now, 0.1 * i) for i, name in enumerate(LINKS))])
        self.second.sendTransform(stamped('base_link', LINKS[3], now, 0.5))


def test_the_tree_and_the_findings_in_a_browser(ros, start, browse, tmp_path):
    """A viewer finds a misspelt name and a second publisher, and works with the tree by keys."""
    Robot(ros)
    view = start(*tool('web_view'), domain=ros.domain)
    with ros.spinning():
        page = browse(view)
        for name, mark in ('base_lnk', 'similar_name'), (LINKS[3], 'two_publishers'):
            page.until(lambda: mark in page.row(name).get_attribute('aria-label'))  # noqa: B023
        page.row('base_lnk').click()
        note = page.row('base_lnk').locator('.note')
        page.until(lambda: 'If they are one frame, use one name' in note.inner_text())
        assert note.bounding_box()['y'] > page.row('base_lnk').locator('.name').bounding_box()['y']
        page.until(lambda: 'is a root' in page.page.inner_text('[data-text="details"]'))
        page.page.screenshot(path=tmp_path / 'findings.png')
        page.page.get_by_role('button', name='two_publishers: ').click()
        page.until(lambda: page.value('publisher').endswith('(more than one publisher)'))
        page.until(lambda: page.row(LINKS[3]).get_attribute('aria-selected') == 'true')
        search = page.page.get_by_role('searchbox', name='Search')
        for text, found in (('LINK_0 03', ['map', 'base_link', LINKS[3]]), ('- (', []),
                            ('link -link_ -base_lnk', ['map', 'base_link'])):
            search.fill(text)
            page.until(lambda: [row.split(',')[0] for row in page.rows()] == found)  # noqa: B023


def test_the_keys_of_the_tree(start, browse):
    """One row is in the order of Tab; arrows move and fold, Enter selects, H hides."""
    start(*ARM)
    page = browse(start(*tool('web_view')))
    page.scene_with(*FRAMES)
    press, focus = page.page.keyboard.press, 'document.activeElement.ariaLabel.split(",")[0]'
    tree = page.page.get_by_role('tree', name='Frames')
    assert tree.locator('[tabindex="0"]').count() == 1
    assert [row.get_attribute('aria-level') for row in tree.get_by_role('treeitem').all()] == [
        *'123456']
    tree.locator('[tabindex="0"]').focus()
    for key, name in (('Home', 'map'), ('ArrowDown', 'base_link'), ('ArrowRight', 'joint_1'),
                      ('End', 'end_effector'), ('ArrowLeft', 'joint_3'), ('ArrowUp', 'joint_2')):
        press(key)
        assert page.page.evaluate(focus) == name
    press('Enter')
    page.until(lambda: page.value('parent') == 'joint_1')
    assert page.row('joint_2').get_attribute('aria-selected') == 'true'
    press('ArrowLeft')
    page.until(lambda: len(page.rows()) == 4)
    assert page.page.evaluate(focus) == 'joint_2'
    assert page.row('joint_2').get_attribute('aria-expanded') == 'false'
    press('ArrowRight')
    page.until(lambda: len(page.rows()) == 6)
    press('h')
    page.until(lambda: 'joint_2' not in page.scene().names and page.rows()[3] == 'joint_2, hidden')


def test_a_view_that_stays_and_is_sent(start, browse, tmp_path):
    """It is there after a reload and a restart; a page that is started with it shows the same."""
    start(*ARM)
    with socket.create_server(('127.0.0.1', 0)) as free:  # no other test takes it meanwhile
        port = free.getsockname()[1]

    view = start(*tool('web_view', '--port', str(port)))
    page = browse(view)
    page.scene_with(*FRAMES)

    def shows(page):
        names = page.scene().names.keys()  # from the top, one of the two covers the other
        return names and names <= {'map, base_link', 'joint_1'}

    page.choose('Fixed frame', 'joint_1')
    page.row('joint_2').hover()
    page.row('joint_2').locator('.eye').click(modifiers=['Shift'])
    page.page.keyboard.press('t')
    page.open_tab('Display')
    page.tick('Grid', False)
    stored = "Object.entries(localStorage).find(([key]) => key.endsWith(' 0'))[1]"

    def is_stored():
        view = json.loads(page.page.evaluate(stored))
        return [view['Fixed frame'], view['Hidden branches'], view['Grid'],
                *view['Camera'][-1:]] == ['joint_1', ['joint_2'], False, 0.1]

    page.until(is_stored)
    page.until(lambda: shows(page))
    page.page.reload()
    page.until(lambda: shows(page))
    view.end_normally()
    status = page.page.locator('#tf-status')
    page.until(lambda: 'no connection for ' in status.inner_text())
    view = start(*tool('web_view', '--port', str(port)))
    page.until(lambda: 'connected' in status.inner_text() and shows(page),
               pause=lambda: page.page.wait_for_timeout(200))
    page.page.screenshot(path=tmp_path / 'view.png')
    (tmp_path / 'view.json').write_text(page.page.evaluate(stored))
    page.page.close()
    other = browse(start(*tool('web_view', '--view', str(tmp_path / 'view.json'))))
    other.until(lambda: shows(other))
    page.faults.clear()  # the connection that was lost


def test_the_keys_and_the_bar_of_a_bag(start, browse, tmp_path):
    """They pause, step and go to a finding and to a time."""
    bags = pytest.importorskip('bags')
    walk = [message for message in bags.walk(20) if not 105.5 < message[1] / bags.S < 108.5]
    bag = bags.make(tmp_path / 'walk', 'mcap', walk)
    view = start(*tool('web_view', '--bag', str(bag)))
    page = browse(view)
    time = page.page.locator('[data-text="time"]')
    bar = page.page.get_by_role('group', name='Playback')
    page.page.wait_for_selector('[data-text="details"]')  # the keys have come before them
    page.page.keyboard.press(' ')
    page.until(lambda: bar.get_by_role('button', name='play', exact=True).count())
    page.page.get_by_role('button', name='gap: base_link').click()
    page.until(lambda: time.inner_text() == '+5.4 s, 105.400000000')
    for key, stamp in (('n', '108.500000000'), ('ArrowLeft', '105.400000000'),
                       ('b', '105.300000000'), ('ArrowRight', '105.400000000')):
        page.page.keyboard.press(key)
        page.until(lambda: time.inner_text().endswith(stamp))  # noqa: B023
    bar.get_by_label('Go to').fill('+99')
    page.page.keyboard.press('Enter')
    page.until(lambda: 'is outside of the bag' in bar.inner_text())
    bar.get_by_label('Go to').fill('+2')
    page.page.keyboard.press('Enter')
    page.until(lambda: time.inner_text() == '+2 s, 102.000000000')
    bar.get_by_label('Time (s)').fill('3.5')
    page.until(lambda: time.inner_text() == '+3.5 s, 103.500000000')
    page.page.screenshot(path=tmp_path / 'bar.png')


@pytest.mark.parametrize(('is_whole', 'health'), [(True, 'healthy'), (False, 'nothing found')])
def test_the_foot_of_a_bag(start, browse, tmp_path, is_whole, health):
    """It calls no bag healthy of which a part is missing."""
    bag = copytree(Path(__file__).parents[1] / 'data/recordings/mcap_split', tmp_path / 'bag')
    if not is_whole:
        (bag / 'mcap_split_1.mcap').unlink()
    page = browse(start(*tool('web_view', '--partial', '--bag', str(bag))))
    page.until(page.page.locator('#tf-status').get_by_text(health, exact=True).count)


def test_a_pair_in_a_browser(start, browse, tmp_path):
    """It is measured by Shift and a click; a line connects the frames, and plots are drawn."""
    start(*ARM)
    view = start(*tool('web_view'))
    page = browse(view)
    page.scene_with(*FRAMES)
    page.open_tab('Robot')
    page.button('Centre')  # so that the name of the hand stays visible
    page.until(lambda: np.allclose(page.scene_with('end_effector').names['end_effector'],
                                   [0.9, 0.0, 0.3], atol=1e-3))
    page.open_tab('Pair')
    page.row('joint_2').click()
    page.until(lambda: page.value('parent') == 'joint_1')
    page.page.keyboard.down('Shift')
    page.click('end_effector', lambda: page.page.get_by_role(
        'combobox', name='B', exact=True).input_value() == 'end_effector')
    page.page.keyboard.up('Shift')
    page.until(lambda: 'distance' in page.page.inner_text('[data-text="pair"]'))
    page.until(lambda: len(page.scene().pair) == 1)
    page.until(lambda: page.page.locator('canvas').count() >= 3)  # the scene and two plots
    page.page.screenshot(path=tmp_path / 'pair.png')


def test_everybody_can_use_the_page(start, browse):
    """By axe, no tab has a serious fault, be it light or dark."""
    axe = pytest.importorskip('axe_playwright_python.sync_playwright').Axe()
    start(*ARM)
    view = start(*tool('web_view'))
    page = browse(view)
    page.scene_with(*FRAMES)
    for is_dark, tabs in (
            (False, ('Pair', 'By hand', 'Robot', 'Frame')), (True, ('Robot', 'Frame'))):
        page.open_tab('Display')
        page.tick('Dark', is_dark)
        for tab in 'Display', *tabs:
            page.open_tab(tab)
            page.page.wait_for_timeout(500)
            faults = [(each['id'], [node['html'] for node in each['nodes']])
                      for each in axe.run(page.page).response['violations']
                      if each['impact'] in ('serious', 'critical')]
            assert not faults


def test_the_page_on_a_narrow_screen(ros, listening, start, browse, tmp_path):
    """The panel is below the scene; a frame is placed by hand, and joints are moved."""
    start(*ARM)
    view = start(*tool('web_view'))
    page = browse(view, 390, 800)
    page.scene_with('end_effector')
    page.open_tab('By hand')
    page.fill('New frame', 'camera')
    page.until(lambda: 'id camera' in command(page))
    page.choose('Parent', 'joint_1')
    page.until(lambda: 'frame-id joint_1' in command(page))
    page.tick('Publish', True)
    ros.until(lambda: 'camera' in listening.frame_names())
    page.open_tab('Frame')
    page.choose('Frame', 'camera')
    page.until(lambda: page.value('publisher') == '/web_view')
    move_the_arm(page, ros, listening)
    page.row('joint_2').click()
    page.until(lambda: page.value('parent') == 'joint_1')
    page.page.screenshot(path=tmp_path / 'web_view_390.png')


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
    number = page.page.locator(f'xpath={behind}input[2]')
    page.button('Centre')  # while the arm waves, its numbers come between those that are typed
    page.until(lambda: number.input_value() == '0')
    number.fill('30')
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
