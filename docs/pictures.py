"""Make the pictures of README.md and docs/, most of them of the running arm: `make pictures`."""

from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from io import BytesIO
from math import degrees, tau
import os
from pathlib import Path
import shutil
import subprocess
import sys
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

os.environ.setdefault('ROS_DOMAIN_ID', '97')  # so that no other arm is in the pictures

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image
from playwright.sync_api import Browser, FloatRect, Page, sync_playwright
import pypdfium2
import rclpy
from rclpy.duration import Duration
from rclpy.time import Time

from dummy_arm.grading.sheet import FRAMES, JOINTS
from puretf import Buffer, SECOND, Transform, TransformListener

DOCS = Path(__file__).parent
sys.path.append(str(DOCS.parent / 'test' / 'support'))
import bags  # noqa: E402

robot_bags: Any = bags  # which has no types

COMMANDS = Path(sys.executable).parent
SECONDS = 30.0
#: The motion repeats after this time (s): all speeds are multiples of 0.1 rad/s.
PERIOD = tau / 0.1
#: The animation shows one period in this many pictures, each for this time (ms).
PICTURES, DURATION = 63, 100
#: The parts of a page with the tree, and with the bar of a bag (pixels).
RIGHT, FOOT = (FloatRect(x=x, y=y, width=width, height=height) for x, y, width, height in (
    (996, 56, 304, 206), (0, 716, 1300, 84)))
SOFTWARE = ('--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader')


@contextmanager
def running(command: str, *arguments: str) -> Iterator['subprocess.Popen[str]']:
    """Run a command of the package until the end of the block."""
    process = subprocess.Popen([COMMANDS / command, *arguments], stdout=subprocess.PIPE,
                               text=True)
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def output(*arguments: str) -> str:
    """Run a command of the package, and return what it prints."""
    command, *others = arguments
    return subprocess.run([COMMANDS / command, *others], check=True, text=True,
                          stdout=subprocess.PIPE).stdout


def frames(path: Path) -> None:
    """Draw frames.pdf."""
    with TemporaryDirectory() as directory:
        output('view_frames', '-o', f'{directory}/frames.pdf')
        with pypdfium2.PdfDocument(f'{directory}/frames.pdf') as pdf:
            pdf[0].render(scale=1.4).to_pil().save(path)


def tree(browser: Browser, path: Path) -> None:
    """Draw the tree in the terminal."""
    text = '$ view_frames --text\n' + output('view_frames', '--text')
    page = browser.new_page(device_scale_factor=1.5)
    page.set_content('<pre style="display: inline-block; margin: 0; padding: 1em; color: #ddd; '
                     f'background: #222; font: 14px monospace">{escape(text.rstrip())}</pre>')
    page.locator('pre').screenshot(path=path)
    page.close()


def page_of_the_arm(browser: Browser, url: str) -> None:
    """Take screenshots of the page, with four of its tabs."""
    page = open_page(browser, url, 1300, 800)
    page.screenshot(path=DOCS / 'web_view.png')
    page.get_by_role('treeitem', name='joint_2').hover()
    page.get_by_role('button', name='hide joint_2').click()
    page.wait_for_timeout(3e3)
    page.screenshot(path=DOCS / 'web_tree.png', clip=RIGHT)
    page.get_by_role('button', name='show joint_2').click()
    page.get_by_role('tab', name='Robot', exact=True).click()
    page.wait_for_timeout(3e3)
    page.screenshot(path=DOCS / 'web_robot.png')
    page.get_by_role('tab', name='Pair', exact=True).click()
    for label, frame in ('A', 'map'), ('B', 'joint_3'):
        page.get_by_role('combobox', name=label, exact=True).click()
        page.get_by_role('option', name=frame, exact=True).click()
    page.wait_for_timeout(6e3)
    page.get_by_role('button', name='pause', exact=True).click()  # axes and body in one update
    page.wait_for_timeout(2e3)
    page.screenshot(path=DOCS / 'web_pair.png')
    page.close()


def page_of_a_bag(browser: Browser) -> None:
    """Take screenshots of the page of a bag with a gap and a misspelt name."""
    with TemporaryDirectory() as directory:
        bag = robot_bags.make(Path(directory, 'bag'), 'mcap', faulty_walk())
        with running('web_view', '--bag', str(bag)) as view:
            assert view.stdout is not None
            page = open_page(browser, view.stdout.readline().split()[-1], 1300, 800)
            page.get_by_role('button', name='gap: base_link').click()
            page.wait_for_timeout(3e3)
            page.screenshot(path=DOCS / 'web_findings.png')
            page.screenshot(path=DOCS / 'web_bag.png', clip=FOOT)
            page.close()


def faulty_walk() -> Iterator[Any]:
    """Yield the messages of a bag: a robot that drives, with faults."""
    for topic, time, rows in robot_bags.walk(20, 20, 1_760_000_000 * SECOND):
        seconds = time / SECOND - 1_760_000_000
        if not 8 < seconds < 12:
            yield topic, time, rows
        if topic == '/tf':
            stamp = rows[0].stamp_ns
            yield topic, time, [
                robot_bags.row(stamp, 'base_link', 'arm', (0.3, 0.0, 0.4, 0.0, 0.0, 0.0, 1.0))]
            yield topic, time, [
                robot_bags.row(stamp, 'base_lnk', 'laser', (0.1, 0.0, 0.4, 0.0, 0.0, 0.0, 1.0))]


def open_page(browser: Browser, url: str, width: int, height: int) -> Page:
    """Open the page of web_view, and wait until it shows the arm."""
    page = browser.new_page(viewport={'width': width, 'height': height})
    page.goto(url)
    page.wait_for_selector('[data-value=rate]', timeout=60e3)
    page.locator('.mantine-Notification-closeButton').first.click()  # there is no GPU, it says
    page.wait_for_timeout(3e3)
    return page


def animation(browser: Browser, url: str, path: Path) -> None:
    """Record one period of the motion in the page, as a GIF that repeats without a jump."""
    page = open_page(browser, url, 900, 480)
    pictures = []
    begin = monotonic()
    for i in range(PICTURES):
        page.wait_for_timeout(max(0.0, begin + i * PERIOD / PICTURES - monotonic()) * 1e3)
        pictures.append(Image.open(BytesIO(page.screenshot())).convert('RGB'))
    page.close()
    # All pictures share one palette, or their background would flicker and the file be larger.
    several = Image.fromarray(np.concatenate([np.asarray(each) for each in pictures[::16]]))
    palette = several.quantize(
        128, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    first, *others = [each.quantize(palette=palette, dither=Image.Dither.NONE)
                      for each in pictures]
    first.save(path, save_all=True, append_images=others, duration=DURATION, loop=0)


def angles(buffer: Buffer, path: Path) -> None:
    """Plot the angles of the joints in the last seconds, and their limits."""
    end = buffer.get_latest_common_time(FRAMES[0], FRAMES[-1]).nanoseconds
    times = np.linspace(end - SECONDS * 1e9, end, 1000).astype(np.int64)
    figure, axes = plt.subplots(figsize=(8, 3.6), layout='constrained')
    for joint in JOINTS:
        _, rotations, _ = buffer.lookup_transforms(joint.parent, joint.name, times)
        turned = np.degrees(2 * np.arctan2(rotations[:, 2], rotations[:, 3]))
        line, = axes.plot((times - times[0]) * 1e-9, turned, label=joint.name)
        for limit in -joint.limit, joint.limit:
            axes.axhline(degrees(limit), color=line.get_color(), linestyle=':', linewidth=1)
    axes.set(xlabel='time (s)', ylabel='angle (degrees)', xlim=(0, SECONDS),
             title='Joint angles, and their limits')
    axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, dpi=110)


def conventions(path: Path) -> None:
    """Draw a point in two frames, and the ways up and down a tree."""
    figure, (plane, tree) = plt.subplots(
        1, 2, figsize=(10, 4.6), layout='constrained', width_ratios=(1.0, 1.15))
    two_frames(plane)
    up_and_down(tree)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def two_frames(axes: Any) -> None:
    """Draw the frames map and robot, and the coordinates of a point in both."""
    half = 0.5**0.5
    robot = Transform(0, 'map', 'robot', (2.0, 1.0, 0.0), (0.0, 0.0, half, half))
    in_robot = np.array([2.0, 1.0, 0.0])
    in_map = robot.apply(in_robot)
    for pose, point, color, at, side in (
            (Transform(0, 'map', 'map'), in_map, 'tab:purple', (-0.45, 3.25), (-0.2, -0.45)),
            (robot, in_robot, 'chocolate', (1.3, 3.25), (0.15, -0.1))):
        name, (x, y, _) = pose.child_frame_id, point
        axes.plot(*pose.apply([(0, 0, 0), (x, 0, 0), (x, y, 0)]).T[:2], '--', color=color,
                  linewidth=2, zorder=1)
        axes.text(*at, f'p_{name} = ({x:.0f}, {y:.0f})', color=color, size=12, weight='bold')
        for axis, color, end, beside in (('x', 'tab:red', (0.8, 0.0, 0.0), (0.8, 0.2, 0.0)),
                                         ('y', 'tab:green', (0.0, 0.8, 0.0), (0.2, 0.8, 0.0))):
            arrow(axes, pose.translation[:2], pose.apply(end)[:2], color=color, linewidth=3)
            axes.text(*pose.apply(beside)[:2], axis, color=color, ha='center', va='center',
                      size=12, weight='bold')
        axes.text(*np.add(pose.translation[:2], side), name, size=13, weight='bold')
    arrow(axes, (0, 0), robot.translation[:2], color='black', linewidth=1.5)
    axes.text(0.7, 0.44, 'map_from_robot', rotation=26.6, rotation_mode='anchor', ha='center')
    axes.plot(*in_map[:2], 'o', color='black', markersize=9)
    axes.set(xlim=(-0.6, 3.3), ylim=(-0.7, 3.6), xticks=range(4), yticks=range(4), xlabel='m',
             aspect='equal')
    axes.grid(alpha=0.3)


def up_and_down(axes: Any) -> None:
    """Draw a tree, the ways of points in it, and a chain."""
    blue: Any = {'color': 'tab:blue', 'va': 'center', 'size': 12}
    for y, name in (2.0, 'map'), (1.0, 'robot'), (0.0, 'camera'):
        axes.text(0, y, name, ha='center', va='center', size=13, weight='bold', bbox={
            'boxstyle': 'round,pad=0.5', 'facecolor': 'white'})
    for y, name in (1.0, 'map_from_robot'), (0.0, 'robot_from_camera'):
        arrow(axes, (-0.2, y + 0.78), (-0.2, y + 0.22), color='dimgray', linewidth=1.5)
        arrow(axes, (0.2, y + 0.22), (0.2, y + 0.78), color='tab:blue', linewidth=3)
        axes.text(0.3, y + 0.5, name, **blue)
    axes.text(-0.3, 1.5, 'edges of the\ntree: from\nparent to child', color='dimgray', ha='right',
              va='center', size=12)
    arrow(axes, (1.95, -0.1), (1.95, 2.1), color='tab:blue', linewidth=3)
    axes.text(2.05, 1.0, 'map_from_camera =\nmap_from_robot @\nrobot_from_camera', **blue)
    axes.text(0.3, 2.4, 'lookup_transform(target, source):\npoints go from source to target',
              **blue)
    axes.set(xlim=(-1.3, 3.6), ylim=(-0.3, 2.6))
    axes.axis('off')


def arrow(axes: Any, begin: Any, end: Any, **style: Any) -> None:
    """Draw an arrow."""
    axes.annotate('', end, begin, arrowprops={
        'arrowstyle': '-|>', 'shrinkA': 0, 'shrinkB': 0, 'mutation_scale': 18, **style})


def main() -> None:
    """Make all of them."""
    chromium = shutil.which('chromium')
    if chromium is None:
        sys.exit('pictures: there is no Chromium: apt install chromium')
    conventions(DOCS / 'conventions.png')
    rclpy.init()
    node = rclpy.create_node('pictures')
    buffer = Buffer(Duration(seconds=2 * SECONDS), node)
    TransformListener(buffer, node)
    with running('dummy_arm'), running('web_view') as view, sync_playwright() as playwright:
        assert view.stdout is not None
        url = view.stdout.readline().split()[-1]
        browser = playwright.chromium.launch(executable_path=chromium, args=[
            '--no-sandbox', '--disable-background-networking', *SOFTWARE])
        begin = buffer.lookup_transform('base_link', 'joint_1', Time(), Duration(seconds=10))
        buffer.lookup_transform(
            'base_link', 'joint_1', Time.from_msg(begin.header.stamp) + Duration(seconds=SECONDS),
            Duration(seconds=2 * SECONDS))
        angles(buffer, DOCS / 'angles.png')
        frames(DOCS / 'frames.png')
        tree(browser, DOCS / 'tree.png')
        output('tf_trajectory', 'map', 'end_effector', '--time', f'{SECONDS}',
               '-o', f'{DOCS}/trajectory.png')
        page_of_the_arm(browser, url)
        page_of_a_bag(browser)
        animation(browser, url, DOCS / 'arm.gif')
        browser.close()
    rclpy.shutdown()


if __name__ == '__main__':
    main()
