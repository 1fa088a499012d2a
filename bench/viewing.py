"""The cost of showing frames in the browser."""

from collections.abc import Iterator
from pathlib import Path
import shutil
import subprocess
import sys
from tempfile import TemporaryDirectory
from time import perf_counter, sleep

from listening import play
from measure import best, cpu_seconds, Row
from playwright.sync_api import Browser, Playwright, sync_playwright
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
import reading
from std_msgs.msg import String

from puretf import bag, TransformBuffer

FRAMES, RATE = 500, 100.0
SECONDS = 10.0
CHROMIUM = shutil.which('chromium')
VIEWERS = str(Path(__file__).with_name('viewers.py'))
DESCRIPTION = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
CODE = 'import sys, puretf_tools.entry_points as e; sys.exit(e.web_view())'


def placing() -> Iterator[Row]:
    """Measure lookups of all frames in one of them."""
    edges = [(f'frame_{max(0, i - 8)}', f'frame_{i}') for i in range(1, FRAMES)]
    buffer = TransformBuffer()
    for stamp in range(10**18, 10**18 + 10**9, 10**7):
        for parent, child in edges:
            buffer.insert(stamp, parent, child, (0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8))
    each = best(lambda: [buffer.lookup_transform('frame_0', child) for _, child in edges])
    at_once = best(lambda: buffer.lookup_all(['frame_0']))
    yield (f'{FRAMES} frames of a tree in its root, one lookup for each',
           f'{each * 1e3:.2f} ms', '', '1')
    yield ('the same by one lookup_all', f'{at_once * 1e3:.2f} ms', '', f'{at_once / each:.2f}')


def load(process: 'subprocess.Popen[str]') -> float:
    """Measure the part of a core that a process uses."""
    before = cpu_seconds(process.pid)
    sleep(SECONDS)
    return (cpu_seconds(process.pid) - before) / SECONDS


def browser_of(playwright: Playwright) -> Browser:
    """Start a browser that draws without a GPU."""
    return playwright.chromium.launch(executable_path=CHROMIUM, args=[
        '--no-sandbox', '--disable-background-networking', '--use-gl=angle',
        '--use-angle=swiftshader', '--enable-unsafe-swiftshader'])


def opening() -> Iterator[Row]:
    """Measure the time from the start of `web_view --bag` to the first frames in the browser."""
    if CHROMIUM is None:
        return
    seconds, hertz, frames = 500, 1000, 20
    for others in 0, 40:
        with (TemporaryDirectory() as directory, sync_playwright() as playwright,
              browser_of(playwright) as browser):
            path = Path(directory, 'bench.mcap')
            reading.write(path, 'mcap', frames, seconds * hertz, hertz, others)
            page, rounds = browser.new_page(), []
            for _ in range(3):
                begin = perf_counter()
                bag.read(path)
                read = perf_counter() - begin
                begin = perf_counter()
                with subprocess.Popen([sys.executable, '-u', '-c', CODE, '--bag', str(path)],
                                      stdout=subprocess.PIPE, text=True) as view:
                    assert view.stdout is not None
                    page.goto(view.stdout.readline().split()[-1])
                    page.wait_for_selector('[data-value=rate]', timeout=60e3)
                    rounds.append((perf_counter() - begin, read))
                    view.terminate()
            shown, read = sorted(rounds)[1]
        yield (f'web_view --bag, {seconds} s at {hertz} Hz, {frames} frames'
               + f', {others} topics with headers' * bool(others) + ', until frames are shown',
               f'{shown:.2f} s', '', f'{shown / read:.2f} of reading it')


def watching() -> Iterator[Row]:
    """Measure what viewers without a browser get of a robot of 80 links, and its cost."""
    frames, rate = 80, 50.0
    links = ''.join(f'<link name="frame_{i}"><visual><geometry><box size="0.1 0.05 0.05"/>'
                    '</geometry></visual></link>' for i in range(frames + 1))
    joints = ''.join(f'<joint name="joint_{i}" type="floating"><parent link="frame_{i}"/>'
                     f'<child link="frame_{i + 1}"/></joint>' for i in range(frames))
    node = rclpy.create_node('describer')
    node.create_publisher(String, '/robot_description', DESCRIPTION).publish(
        String(data=f'<robot name="chain">{links}{joints}</robot>'))
    for count in 1, 3:
        with (play('send', 'tf', str(rate), str(frames), '100') as sender,
              subprocess.Popen([sys.executable, '-u', '-c', CODE], stdout=subprocess.PIPE,
                               text=True) as view):
            assert view.stdout is not None
            port = view.stdout.readline().strip().rpartition(':')[2]
            with subprocess.Popen([sys.executable, VIEWERS, port, str(count), str(SECONDS)],
                                  stdout=subprocess.PIPE, text=True) as viewers:
                sleep(5.0)
                used = load(view)
                size, updates = map(float, viewers.communicate()[0].split())
            view.terminate()
            sender.terminate()
        yield (f'web_view, {frames} frames with bodies at {rate:g} Hz, '
               f'{count} viewer{"s" * (count > 1)}', f'{used:.1%} of a core', '',
               f'{updates:.1f} updates/s and {size / 1e3:.0f} kB/s for each')
    node.destroy_node()


def showing() -> Iterator[Row]:
    """Measure the process of web_view, without and with a viewer."""
    if CHROMIUM is None:
        yield ('web_view', 'not measured', '', 'there is no chromium')
        return
    with (play('send', 'tf', str(RATE), str(FRAMES), '100') as sender,
          subprocess.Popen([sys.executable, '-u', '-c', CODE], stdout=subprocess.PIPE, text=True
                           ) as view, sync_playwright() as playwright):
        assert view.stdout is not None
        url = view.stdout.readline().split()[-1]
        sleep(3.0)
        alone = load(view)
        browser = browser_of(playwright)
        page = browser.new_page()
        page.goto(url)
        page.wait_for_selector('[data-value=rate]', timeout=60e3)
        sleep(3.0)
        viewed = load(view)
        page.get_by_role('tab', name='Display').click()
        page.get_by_label('Show names', exact=True).check(force=True)
        sleep(3.0)
        with_names = load(view)
        browser.close()
        view.terminate()
        sender.terminate()
    what = f'web_view, {FRAMES} frames at {RATE:g} Hz'
    yield f'{what}, no viewer', f'{alone:.1%} of a core', '', ''
    yield f'{what}, one viewer', f'{viewed:.1%} of a core', '', f'{viewed / alone:.1f}'
    yield (f'{what}, one viewer, all names shown', f'{with_names:.1%} of a core', '',
           f'{with_names / alone:.1f}')
