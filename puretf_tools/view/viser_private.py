"""
A server of viser that checks requests, and ends the connection of a client that sends nonsense.

It uses private parts of viser 1.1.1, which test/unit/test_viser_private.py checks:

- To start its server, viser calls `websockets.asyncio.server.serve` by this full name, with the
  argument `process_request`; `_websock_server` exists by then.
- `_websock_server` and each connection of a client pass every message to their method
  `_handle_incoming_message`, in a task whose exception nothing handles. `_live_connections` has
  the WebSocket of each client.
- A node passes messages about its pose to `_impl.api._queue_scene_message`. Its setters compare
  poses by `numpy.allclose`, which takes most of the time, and ignores small moves far away.
- `get_message_buffer().max_window_size` of `_websock_connection` limits the number of messages
  that a client receives at once.
- additions.html names controls by their classes, finds the panels by attributes `data-dock-…`,
  and stores what it measures under keys that begin with `viser-user:`.
"""

from collections.abc import Callable
from http import HTTPStatus
import logging
from math import hypot, isclose, isfinite
import socket
from typing import Any, Optional, TYPE_CHECKING
import warnings

from puretf_tools.cli.parser import CommandError

#: The versions of viser that can be used, as in setup.py.
VISER = 'viser>=1.1.1,<1.2'

try:
    import viser  # isort: skip  (an error is to name it, and not a library that comes with it)
    import rich
    from viser._messages import SetOrientationMessage, SetPositionMessage
    import websockets.asyncio.server
except ImportError as error:
    raise CommandError(f'viser, which makes the page, cannot be imported ({error}): '
                       f"pip install '{VISER}'") from None

if TYPE_CHECKING:
    from websockets import Headers

#: The largest size of a message from a client (bytes); viser's own limit is 50 MB.
LONGEST = 2**16
#: What the page sends. viser would also take uploads, and requests to make the page public.
_MESSAGES = (
    'ViewerCameraMessage', 'SceneNodeClickMessage', 'ScenePointerMessage', 'GuiUpdateMessage',
    'CommandTriggerMessage',
    'LocalStorageGetItemResponseMessage', 'TransformControlsDragStartMessage',
    'TransformControlsUpdateMessage', 'TransformControlsDragEndMessage')
#: The largest number of messages of an update.
_LARGEST_UPDATE = 100_000
#: The node in which everything is drawn, and the only one that a viewer can move.
WORLD = '/world'
HANDLES = f'{WORLD}/hand_frame/handles'
#: The largest error of the length of a quaternion, of which a browser sends float64 numbers.
_TOLERANCE = 1e-3

#: The keys in a browser's storage of what additions.html measures: the number of pixels of the
#: display per pixel of CSS, and where the panels are.
PIXEL_RATIO, PANELS = 'pixel ratio', 'panels'

Vector = tuple[float, float, float]
Wxyz = tuple[float, float, float, float]
#: The arguments of `set_pose`.
Move = tuple[viser.SceneNodeHandle, Vector, Optional[Wxyz]]

_SERVE = websockets.asyncio.server.serve


class Server(viser.ViserServer):
    """A server whose viewers can only look at the scene and use the panel."""

    def __init__(self, listening: socket.socket, why_refused: Callable[['Headers'], str]) -> None:
        """Start; `why_refused` returns why a request with these headers is refused, or ''."""
        self._listening, self._why_refused, self._is_guarded = listening, why_refused, False
        address, port, *_ = listening.getsockname()
        _silence()
        websockets.asyncio.server.serve = self._serve
        try:
            super().__init__(address, port, verbose=False)
        finally:
            websockets.asyncio.server.serve = _SERVE
        if not self._is_guarded:
            self.stop()
            listening.close()
            raise CommandError(
                f'viser {viser.__version__} does not start its server by websockets.asyncio.'
                'server.serve, so requests of other pages could not be refused: '
                f"pip install '{VISER}'")

    def _serve(self, handler: Any, host: object = None, port: object = None, *,
               process_request: Callable[..., Any], **kwargs: Any) -> Any:
        """Call `serve` with our socket (viser would try the next port), limit and checks."""
        self._is_guarded = True
        self._guard_messages(self._websock_server)
        self._websock_server.on_client_connect(self._guard_messages)

        def process(connection: Any, request: Any) -> Any:
            if why := self._why_refused(request.headers):
                return connection.respond(HTTPStatus.FORBIDDEN, f'{why}\n')
            return process_request(connection, request)

        return _SERVE(handler, **{**kwargs, 'sock': self._listening, 'process_request': process,
                                  'max_size': LONGEST})

    def _guard_messages(self, receiver: Any) -> None:
        """Let a message that is not allowed, or whose handler fails, end its connection."""
        handle = receiver._handle_incoming_message

        async def handle_or_close(client_id: int, message: Any) -> None:
            try:
                _check(message)
                await handle(client_id, message)
            except Exception:
                logging.getLogger(__name__).debug('a viewer is disconnected', exc_info=True)
                if connection := self._websock_server._live_connections.get(client_id):
                    await connection.close(1008)  # policy violation

        receiver._handle_incoming_message = handle_or_close


def receive_at_once(client: viser.ClientHandle) -> None:
    """Let a client receive all messages of an update at once."""
    client._websock_connection.get_message_buffer().max_window_size = _LARGEST_UPDATE


def set_pose(node: viser.SceneNodeHandle, position: Vector, wxyz: Optional[Wxyz] = None
             ) -> None:
    """Set the position (m) of a node, and its rotation if one is given."""
    queue = node._impl.api._queue_scene_message
    node._impl.position[:] = position
    queue(SetPositionMessage(node.name, position))
    if wxyz is not None:
        node._impl.wxyz[:] = wxyz
        queue(SetOrientationMessage(node.name, wxyz))


def _check(message: Any) -> None:
    """Raise ValueError for a message by which a viewer would not only look and use the panel."""
    if type(message).__name__ not in _MESSAGES:
        raise ValueError(type(message))
    # viser would set any attribute of a control.
    if hasattr(message, 'updates'):
        if message.updates.keys() != {'value'}:
            raise ValueError(message.updates)
        value = message.updates['value']
        numbers = value if isinstance(value, (list, tuple)) else [value]
        if not all(isfinite(each) for each in numbers if isinstance(each, float)):
            raise ValueError(message.updates)
    if type(message).__name__.startswith('TransformControls') and message.name != HANDLES:
        raise ValueError(message.name)
    if hasattr(message, 'wxyz'):
        # Floats, since viser would keep three ints as an array of ints, and round the next pose.
        w, x, y, z = message.wxyz = tuple(map(float, message.wxyz))
        a, b, c = message.position = tuple(map(float, message.position))
        if not isclose(hypot(w, x, y, z), 1.0, abs_tol=_TOLERANCE) or not isfinite(
                hypot(a, b, c)):
            raise ValueError(message)
    if hasattr(message, 'look_at') and not (
            hypot(*message.up_direction) > 0.0 and all(map(isfinite, (
                *message.look_at, *message.up_direction, message.fov, message.image_width,
                message.image_height)))):
        raise ValueError(message)


def _silence() -> None:
    # viser would print its address, and a line when it stops.
    rich.reconfigure(quiet=True)
    # viser would warn of messages to a client that has just disconnected, and of nonsense.
    warnings.filterwarnings('ignore', r'Queued a |\[viser\] ')
    # websockets would log each malformed request or message with a traceback.
    logging.getLogger('websockets').setLevel(logging.CRITICAL)
