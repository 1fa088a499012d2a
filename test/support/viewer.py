"""A viewer of the page of web_view, without a browser: it sends and receives messages."""

import base64
from collections.abc import Callable
from contextlib import suppress
import json
import re
import time
from typing import Any, cast, Optional

import numpy as np
from processes import TIMEOUT
import pytest

from puretf_tools.view.feed import Feed, HandPublisher

viser = pytest.importorskip('viser', reason='viser, which makes the page, is not installed')
msgspec, zstandard = map(pytest.importorskip, ('msgspec', 'zstandard'))
connect = pytest.importorskip('websockets.sync.client').connect

#: The message that makes viser call the program: "a client is there". The page is so large that no
#: name covers another one.
CAMERA = {'type': 'ViewerCameraMessage', 'wxyz': [1.0, 0.0, 0.0, 0.0], 'position': [1, 2, 3],
          'fov': 0.8, 'near': 0.01, 'far': 1000, 'image_height': 6000, 'image_width': 8000,
          'look_at': [0, 0.0, 0], 'up_direction': [0.0, 0.0, 1.0]}
CLICK = {'type': 'SceneNodeClickMessage', 'name': '/world/frames', 'instance_index': None,
         'ray_origin': [0.0, 0.0, 1.0], 'ray_direction': [0, 0, 1], 'screen_pos': [0.5, 0.5],
         'modifier': None, 'owner': ''}
POINTER = {'type': 'ScenePointerMessage', 'event_type': 'click', 'ray_origin': [0.0, 0.0, 1.0],
           'ray_direction': [0, 0, 1], 'screen_pos': [[0.5, 0.5]], 'modifier': None}


def update(uuid: str, /, **updates: object) -> dict[str, object]:
    """Return the message by which a control changes."""
    return {'type': 'GuiUpdateMessage', 'uuid': uuid, 'updates': updates}


class Viewer:
    """A client of the page, and what it has been told of the page."""

    def __init__(self, port: int, host: str = '127.0.0.1', **camera: object) -> None:
        """Connect as the page does; the camera is `CAMERA` with some changes."""
        self._connection = connect(
            f'ws://{host}:{port}', subprotocols=[f'viser-v{viser.__version__}'],
            max_size=None, compression=None, close_timeout=1.0)
        self.port = port
        self.size = 0  #: the number of bytes that were received
        self.camera = {**CAMERA, **camera}
        self.send(self.camera)
        #: The properties of each control and text by its uuid, and of each node by its name.
        self.gui: dict[str, dict[str, Any]] = {}
        self.nodes: dict[str, dict[str, Any]] = {}
        #: By type: the last message of those that are neither of the panel nor of the scene.
        self.last: dict[str, dict[str, Any]] = {}
        self.storage: dict[str, str] = {}  #: what the browser has stored
        self.blocked: Optional[str] = None  #: why it stores nothing
        self._count = 0  # of what was done in the page

    def send(self, message: object) -> None:
        """Send bytes, a text or a message."""
        self._connection.send(
            message if isinstance(message, (bytes, str)) else msgspec.msgpack.encode(message))

    def receive(self, timeout: float) -> None:
        """Receive the next messages; `TimeoutError`: there are none."""
        window = self._connection.recv(timeout)
        self.size += len(window)
        begin = 16 + int.from_bytes(window[8:16], 'little')
        content = msgspec.msgpack.decode(
            zstandard.ZstdDecompressor().decompress(window[16:begin]))
        arrays = []
        for length in content['binaryBufferLengths']:
            begin = -(-begin // 8) * 8
            arrays.append(window[begin:begin + length])
            begin += length

        def filled(value: Any) -> Any:
            if isinstance(value, dict) and '__binary_index' in value:
                return np.frombuffer(arrays[value['__binary_index']], value['dtype'])
            return [*map(filled, value)] if isinstance(value, list) else value

        for message in content['messages']:
            if message['type'] == 'LocalStorageGetItemRequestMessage':
                self.send({'type': 'LocalStorageGetItemResponseMessage',
                           'value': self.storage.get(message['key']), 'error': self.blocked,
                           'request_uuid': message['request_uuid']})
            elif message['type'] == 'LocalStorageSetItemMessage':
                self.storage[message['key']] = message['value']
            elif message['type'] == 'GuiRemoveMessage':
                self.gui.pop(message['uuid'], None)
            elif message['type'] == 'RemoveSceneNodeMessage':
                self.nodes.pop(message['name'], None)
            else:
                place = (self.gui.setdefault(message['uuid'], {}) if 'uuid' in message else
                         self.nodes.setdefault(message['name'], {}) if 'name' in message else
                         self.last.setdefault(message['type'], {}))
                for part in message, message.get('props', {}), message.get('updates', {}):
                    place.update((key, filled(value)) for key, value in part.items())

    def until(self, condition: Callable[[], object],
              update: Callable[[], object] = lambda: None) -> None:
        """
        Receive messages until a condition holds.

        :param update: what is called before each check, such as `View.update`.
        """
        deadline = time.monotonic() + TIMEOUT
        while not condition():
            assert time.monotonic() < deadline, 'waited in vain: ' + ', '.join(
                f'{props["label"]}: {props.get("value")}' for props in self.gui.values()
                if 'label' in props)
            update()
            with suppress(TimeoutError):
                self.receive(0.02)

    def uuid(self, label: str) -> str:
        """Return the uuid of a control."""
        uuid: str = self._control(label)['uuid']
        return uuid

    def shown(self, kind: str = 'state') -> dict[str, Any]:
        """Return the values for the script of the page, 'state' or 'bar'; {}: not there yet."""
        found = next((props['content'] for props in self.gui.values()
                      if f'data-tf="{kind}"' in props.get('content', '')), '>{}<')
        values: dict[str, Any] = json.loads(found[found.index('>') + 1:found.rindex('<')])
        return values

    def act(self, action: str, what: str = '') -> None:
        """Send what the script sends when a viewer does something, such as 'select' a frame."""
        self._count += 1
        self.send(update(self.shown()['events'], value=f'{self._count} {action} {what}'))

    def press(self, key: str) -> None:
        """Press a key of a command."""
        self.send({'type': 'CommandTriggerMessage', 'uuid': next(
            uuid for uuid, props in self.gui.items() if props.get('hotkey') == key)})

    def click(self, point: Any, modifier: Any = None) -> None:
        """Click a point of the scene: x, y, z (m)."""
        camera: Any = self.camera
        x, y, z = viser.transforms.SO3(np.array(camera['wxyz'])).inverse().apply(
            np.subtract(point, camera['position'])).tolist()
        focal = camera['image_height'] / 2 / np.tan(camera['fov'] / 2) / z
        place = [float(0.5 + focal * x / camera['image_width']),
                 float(0.5 + focal * y / camera['image_height'])]
        self.send({**POINTER, 'screen_pos': [place], 'modifier': modifier})

    def get(self, label: str, key: str) -> Any:
        """Return a property of a control; None: it is not there."""
        return self._control(label).get(key)

    def _control(self, label: str) -> dict[str, Any]:
        """Return the properties of a control, unlike those of a command; {}: it is not there."""
        return next((props for props in self.gui.values()
                     if props.get('label') == label and 'hotkey' not in props), {})

    def value(self, label: str) -> Any:
        """Return the value of a control; None: it is not there."""
        return self.get(label, 'value')

    def set(self, label: str, value: object) -> None:
        """Change the value of a control."""
        self.gui[self.uuid(label)]['value'] = value
        self.send(update(self.uuid(label), value=value))

    def text(self, key: str) -> str:
        """Return the text 'overview' or 'details'; '' if it is not there yet."""
        return next((props['content'] for props in self.gui.values()
                     if f'data-text="{key}"' in props.get('content', '')), '')

    def detail(self, key: str) -> str:
        """Return a value in the table of the selected frame; '' if there is none."""
        found = re.search(rf'data-value="{key}"[^>]*>(?:<th>[^<]*</th>)?((<td>[^<]*</td>)+|[^<]*)',
                          self.text('details'))
        return ' '.join(re.sub('<[^>]*>', ' ', found[1]).split()) if found else ''

    def names(self) -> dict[str, list[float]]:
        """Return the names that are shown, and their positions (m)."""
        return {node['text']: [*node.get('position', (0.0, 0.0, 0.0))]  # viser's default
                for name, node in self.nodes.items()
                if name.startswith('/world/names/') and node.get('visible')}

    def distance(self) -> float:
        """Return how far the camera was set from its target (m); 0.0: not yet."""
        position, target = (self.last.get(f'SetCamera{name}Message', {}).get(key) for name, key in
                            (('Position', 'position'), ('LookAt', 'look_at')))
        return float(np.linalg.norm(np.subtract(position, target))) if position and target else 0.0

    def trail(self) -> Any:
        """Return the lines of the trail: (m, 2, 3), the oldest first."""
        pieces = sorted((int(name.split('/')[3]), node['points'])
                        for name, node in self.nodes.items() if name.startswith('/world/trail/'))
        return np.concatenate([[], *(points for _, points in pieces)]).reshape(-1, 2, 3)

    def axes(self, key: str) -> Any:
        """
        Return a property of the axes of the frames, see `puretf_tools.view.axes_and_trail.Axes`.

        :param key: 'positions', 'wxyzs' or 'scales'.
        """
        width = {'positions': (3,), 'wxyzs': (4,), 'scales': ()}[key]
        return self.nodes['/world/frames'][f'batched_{key}'].reshape(-1, *width)

    def close(self) -> None:
        """Disconnect."""
        self._connection.close()


def recorded(page):
    """Return the scene that is in a page: the time and the properties of each message."""
    scene = page.split('window.__VISER_EMBED_DATA__="')[1].split('"')[0]
    content = zstandard.ZstdDecompressor().decompress(base64.b64decode(scene)[8:])
    return msgspec.msgpack.decode(content[8:8 + int.from_bytes(content[:8], 'little')])


class StubFeed(Feed):
    """A feed with the same facts about every frame, and what is published by hand."""

    name, hint, time = '/tf', 'other <topics>', 0

    def __init__(self, buffer, publication=(None, '')):
        """Create a feed of a buffer; `why` is the reason by which it refuses what is published."""
        self.buffer = buffer
        self._publication = publication
        self.sent, self.stopped, self.why = [], [], ''
        self.hand_publisher = cast(HandPublisher, self)

    def now(self):
        """Return a time (ns)."""
        return self.time

    def publication(self, frame):
        """Return the facts, whatever the frame is."""
        return self._publication

    def why_no_frames(self):
        """Return a reason."""
        return 'because'

    def send(self, transform, _):
        """Publish a frame."""
        self.sent.append(transform)
        return self.why

    def stop(self, name):
        """Stop publishing a frame."""
        self.stopped.append(name)


class Page:
    """The page of a feed, a viewer of it, and the clock of both."""

    def __init__(self, feed, clock, stack, meshes=(), view='', storage=()):
        """
        Serve and update the page, and connect the viewer; `clock[0]`: the time (s).

        :param storage: what the browser has stored.
        """
        from puretf_tools.view.server import serve
        from puretf_tools.view.view import View
        self.feed, self.clock = feed, clock
        self.server = stack.enter_context(serve('127.0.0.1'))
        self.view = View(feed, self.server, lambda: clock[0], meshes, view)
        self.view.update()
        self.viewer = Viewer(self.server.get_port())
        self.viewer.storage.update(storage)
        stack.callback(self.viewer.close)
        self.until(lambda: self.viewer.shown() and any(  # the last control
            props.get('label') == 'Publish' for props in self.viewer.gui.values()))

    def update(self):
        """
        Update the page as time passes: enough for the texts, not for a frame to fade.

        Before, the viewer handles the last update.
        """
        # Other viewers may not be read.
        for _ in range(20 if len(self.view.viewers) > 1 else 1000):
            if not any(viewer.pace.is_waiting for viewer in self.view.viewers.values()):
                break
            with suppress(TimeoutError):
                self.viewer.receive(0.01)
        self.clock[0] += 0.01
        self.view.update()

    def step(self):
        """Update the page, and let the viewer handle what it is sent."""
        self.update()
        with suppress(TimeoutError):
            while True:
                self.viewer.receive(0.05)

    def set(self, label, value):
        """
        Change a control, and wait until the server has handled this.

        Meanwhile the page is not updated: an update could overwrite the value before it is read.
        """
        self.viewer.set(label, value)
        self._handled()

    def act(self, action, what=''):
        """Do something in the page, and wait until the server has received this."""
        self.viewer.act(action, what)
        self._handled()

    def _handled(self):
        self.viewer.set('Paste view', '{}')  # which the server empties
        self.viewer.until(lambda: not self.viewer.value('Paste view'))

    def until(self, condition):
        """Update the page until a condition holds."""
        self.viewer.until(condition, self.update)
