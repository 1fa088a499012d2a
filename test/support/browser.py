"""The page of web_view in a real browser: headless Chromium, driven by Playwright."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import fcntl
from functools import partial
import re
import shutil
import time
from typing import Any, TYPE_CHECKING
from urllib.parse import urlsplit

import numpy as np
import pytest

if TYPE_CHECKING:
    from playwright.sync_api import ConsoleMessage, Page

pytest.importorskip('viser', reason='viser, which makes the page, is not installed')
playwright = pytest.importorskip('playwright.sync_api', reason='playwright is not installed')

CHROMIUM = next(filter(None, map(shutil.which, (
    'chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable'))), None)
if CHROMIUM is None:
    pytest.skip('there is no Chromium: apt install chromium', allow_module_level=True)

_TIMEOUT = 180.0  # s; drawing without a GPU is slow
_FEWER_PIXELS = '/?fixedDpr=0.5'  # a setting of viser: drawing is twice as fast
_PAUSE = partial(time.sleep, 0.05)
_NOTHING_BEYOND_LOOPBACK = (
    '--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1', '--disable-background-networking',
    '--disable-component-update', '--disable-sync', '--disable-quic', '--no-first-run')
_IN_SOFTWARE = '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'
#: Reads the scene after the next picture: before, what has arrived is only partly drawn.
_SCENE = """() => new Promise(resolve => {
    const mutable = window.__viserMutable;
    let root = mutable.nodeRefFromName['/world/frames'];
    if (!root) return resolve(scene());
    while (root.parent) root = root.parent;
    root.onAfterRender = () => { root.onAfterRender = () => {}; resolve(scene()); };
    mutable.requestRender();
    function scene() {
        const mutable = window.__viserMutable, tree = window.__viserSceneTree.getState();
        const names = {}, bodies = [];
        for (const [key, node] of Object.entries(tree))
            if (key.startsWith('/world/names/') && node.effectiveVisibility)
                names[node.message.props.text] = mutable.nodePoseData[key].position;
            else if (/^\\/world\\/robots\\/\\d+$/.test(key) && node.effectiveVisibility)
                bodies.push(mutable.nodePoseData[key].position);
        let mesh = null;
        const isShown = key => tree[key]?.effectiveVisibility;
        const frames = isShown('/world/frames') ? mutable.nodeRefFromName['/world/frames'] : null;
        frames?.traverse(o => { if (o.isInstancedMesh && !mesh) mesh = o; });
        const axes = [], length = tree['/world/frames']?.message.props.axes_length ?? 0.0;
        for (let i = 0; i < (mesh?.count ?? 0); i++) {
            const matrix = mesh.matrixWorld.clone();
            mesh.getMatrixAt(i, matrix);
            axes.push(Array.from(matrix.elements));
        }
        const segments = key => {
            const found = [];
            mutable.nodeRefFromName[key]?.traverse(o => {
                const start = o.geometry?.attributes.instanceStart;
                if (start && !found.length) found.push(...start.data.array);
            });
            return found;
        };
        const lines = isShown('/world/lines') ? segments('/world/lines') : [];
        const trail = Object.keys(tree).filter(key => key.startsWith('/world/trail/')
            && isShown(key)).sort((a, b) => a.split('/')[3] - b.split('/')[3]).flatMap(segments);
        const pair = isShown('/world/pair') ? segments('/world/pair') : [];
        return {names, axes, length, lines, pair, bodies, trail};
    }
})"""

_WHERE = """point => {
    const {camera, canvas, nodeRefFromName} = window.__viserMutable;
    const seen = camera.position.clone().set(...point)
        .applyMatrix4(nodeRefFromName['/world/frames'].matrixWorld).project(camera);
    const {left, top, width, height} = canvas.getBoundingClientRect();
    return [left + (1 + seen.x) / 2 * width, top + (1 - seen.y) / 2 * height];
}"""


_TEXTS = """() => Array.from(document.querySelectorAll('[data-text]'),
    text => `${text.dataset.text}:\\n${text.innerText}`).join('\\n')"""


class Scene:
    """The scene that the page draws."""

    def __init__(self, drawn: dict[str, Any]) -> None:
        """Create a scene from the result of _SCENE."""
        #: The names that are shown, and their positions (m).
        self.names = {name: np.array(place) for name, place in drawn['names'].items()}
        #: (k, 3): the positions of the links whose shapes are drawn (m).
        self.bodies = np.array(drawn['bodies']).reshape(-1, 3)
        axes = np.array(drawn['axes']).reshape(-1, 3, 16).swapaxes(0, 1)
        middles, along = axes[..., 12:15], axes[..., 4:7] * drawn['length'] / 2
        #: (3, n, 3): the beginnings and the ends of the x, y and z axes (m).
        self.begins, self.ends = middles - along, middles + along
        #: (n,): the lengths of the axes of each frame (m); 0 if they are not drawn.
        self.lengths = np.linalg.norm(2 * along[0], axis=1)
        #: (k, 2, 3): the lines from frames to their parents (m).
        self.lines = np.array(drawn['lines']).reshape(-1, 2, 3)
        #: (0 or 1, 2, 3): the line of the pair (m).
        self.pair = np.array(drawn['pair']).reshape(-1, 2, 3)
        #: (m, 2, 3): the segments of the trail (m).
        self.trail = np.array(drawn['trail']).reshape(-1, 2, 3)

    def is_together(self) -> bool:
        """Return whether names and lines are where axes are."""
        return all(np.linalg.norm(self.begins[0] - place, axis=1).min() < 1e-3
                   for place in self.names.values()) and all(
            np.linalg.norm(self.begins[0] - line[0], axis=1).min() < 1e-3 for line in self.lines)

    def index(self, name: str) -> int:
        """Return the index of the frame that is drawn at the position of a name."""
        distances = np.linalg.norm(self.begins[0] - self.names[name], axis=1)
        assert distances.min() < 0.05, f'{name} is {distances.min()} m from the next axes'
        return int(distances.argmin())


class BrowserPage:
    """The page of web_view, open in a browser."""

    def __init__(self, page: 'Page', url: str) -> None:
        """Open the page."""
        self.page = page
        self.faults: list[str] = []
        self.hosts: set[str] = set()
        page.set_default_timeout(_TIMEOUT * 1e3)
        page.on('request', lambda request: self.hosts.add(urlsplit(request.url).hostname))
        page.on('websocket', lambda socket: self.hosts.add(urlsplit(socket.url).hostname))
        page.on('pageerror', lambda error: self.faults.append(str(error)))
        page.on('console', self._note)
        page.goto(url + _FEWER_PIXELS * url.startswith('http'))

    def _note(self, message: 'ConsoleMessage') -> None:
        if message.type == 'error':
            self.faults.append(message.text)

    def scene(self) -> Scene:
        """Return the scene that is drawn now."""
        return Scene(self.page.evaluate(_SCENE))

    def scene_with(self, *names: str) -> Scene:
        """Wait until names are shown and their frames drawn, and return the scene."""
        found: Scene = self.until(lambda: (scene := self.scene()).names.keys() >= {*names}
                                  and (scene.begins.size or not names) and scene)
        return found

    def until(self, condition, timeout=_TIMEOUT, pause=_PAUSE):
        """
        Wait until a condition is true, and return its value.

        :param pause: what is called between two checks.
        """
        deadline = time.monotonic() + timeout
        while True:
            try:
                if holds := condition():
                    return holds
            except playwright.Error:  # there is no scene yet
                holds = None
            assert time.monotonic() < deadline, f'waited in vain; {self.description()}'
            pause()

    def description(self) -> str:
        """Return what the page shows, for the message of a test that fails."""
        try:
            texts, names = self.page.evaluate(_TEXTS), self.scene().names
        except playwright.Error as error:
            texts, names = f'no page: {error}', {}
        places = ', '.join(f'{name} at {place.tolist()}' for name, place in names.items())
        return f'faults: {self.faults}\n{texts}\nrows: {self.rows()}\nnames: {places}'

    def value(self, key: str) -> str:
        """Return a value in the table of the selected frame."""
        text: str = self.page.inner_text(f'[data-value="{key}"]')
        return text

    def numbers(self, key: str) -> list[float]:
        """Return the numbers of a value."""
        cells = self.page.locator(f'[data-value="{key}"] td').all_inner_texts()
        return [*map(float, filter(None, cells))]

    def choose(self, label: str, frame: str) -> None:
        """Choose a frame in a dropdown."""
        self.page.get_by_role('combobox', name=label, exact=True).click()
        self.page.get_by_role('option', name=frame, exact=True).click()

    def click(self, name: str, condition: Callable[[], object]) -> None:
        """Click the z axis of a frame until a condition holds: the camera may just move."""
        def click() -> None:
            scene = self.scene()
            i = scene.index(name)
            middle = (scene.begins[2, i] + scene.ends[2, i]) / 2
            self.page.mouse.click(*self.page.evaluate(_WHERE, middle.tolist()))
            self.page.wait_for_timeout(1e3)

        self.until(condition, pause=click)

    def fill(self, label: str, text: str) -> None:
        """Type a text into a field; viser's label does not belong to its field."""
        self.page.locator(f'xpath=//label[.="{label}"]/following::input[1]').fill(text)

    def open_tab(self, name: str) -> None:
        """Open a tab of the panel."""
        self.page.get_by_role('tab', name=name, exact=True).click()

    def button(self, text: str) -> None:
        """Press the button with a text, or the first one whose text has it as a word."""
        exact = self.page.get_by_role('button', name=text, exact=True)
        word = self.page.get_by_role('button').filter(has_text=re.compile(rf'\b{text}\b'))
        (exact if exact.count() else word).first.click()

    def rows(self) -> list[str]:
        """Return what the rows of the tree say to a screen reader."""
        texts: list[str] = self.page.get_by_role('treeitem').evaluate_all(
            'rows => rows.map(row => row.ariaLabel)')
        return texts

    def row(self, name: str) -> Any:
        """Return the row of a frame."""
        return self.page.get_by_role('treeitem', name=re.compile(f'^{re.escape(name)}(,|$)'))

    def tick(self, label: str, is_on: bool) -> None:
        """Check or uncheck a checkbox."""
        # `set_checked` fails if a busy page shows the new state only after a while.
        box = self.page.get_by_label(label, exact=True)
        if box.is_checked() != is_on:
            box.click(force=True)
        self.until(lambda: box.is_checked() == is_on)


@contextmanager
def pages() -> Iterator[Callable[..., BrowserPage]]:
    """
    Start a browser; return a function that opens a page, which must have no faults.

    There is one browser at a time, whatever the number of workers: drawing takes all cores.
    """
    with open(__file__) as lock, playwright.sync_playwright() as started:
        fcntl.flock(lock, fcntl.LOCK_EX)
        browser = started.chromium.launch(executable_path=CHROMIUM, args=[
            '--no-sandbox', *_NOTHING_BEYOND_LOOPBACK, *_IN_SOFTWARE])
        opened: list[BrowserPage] = []

        def open_page(url: str, width: int = 1500, height: int = 800) -> BrowserPage:
            opened.append(BrowserPage(
                browser.new_page(viewport={'width': width, 'height': height}), url))
            return opened[-1]

        yield open_page
        for each in opened:
            each.page.close()
            assert each.hosts <= {'127.0.0.1', None}  # None: of data: and blob: URLs
            assert not each.faults
        browser.close()
