"""
A server of viser that checks requests, and ends the connection of a client that sends nonsense.

It uses private parts of viser 1.1.1, which test/unit/test_viser_private.py checks:

- To start its server, viser calls `websockets.asyncio.server.serve` by this full name, with the
  argument `process_request`; `_websock_server` exists by then.
- `_websock_server` and each connection of a client pass every message to their method
  `_handle_incoming_message`, in a task whose exception nothing handles. `_live_connections` has
  the WebSocket of each client.
- `gui._gui_input_handle_from_uuid` has the controls, whose values viser casts, and does not check.
- A node passes messages about its pose to `_impl.api._queue_scene_message`. Its setters compare
  poses by `numpy.allclose`, which takes most of the time, and ignores small moves far away.
- `get_message_buffer().max_window_size` of `_websock_connection` limits the number of messages
  that a client receives at once.
- `push` of a message buffer sets its `message_event` outside of the event loop, too: if the loop
  just begins to wait for it, nothing wakes it later. `push` and `atomic_end` let the loop set it,
  too.
- The page, its only file, has '<title>Viser</title>' in its head, before its code. head.html
  changes its shaders of labels.
- A control has its `_impl.uuid`, under which page.js changes it by `__viserMutable.sendMessage`.
  page.js names controls by their classes.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
import gzip
from html import escape
from http import HTTPStatus
import logging
from math import hypot, isclose, isfinite
from pathlib import Path
import socket
from time import monotonic
from typing import Any, TYPE_CHECKING
import warnings

import numpy as np

from puretf._text.names import abbreviated, visible
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
#: The shortest time between two lines of the log (s), and the length of the reason in one.
_LOG_PERIOD, _LONGEST_REASON = 1.0, 200
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

#: The key in a browser's storage of what head.html says of the page.
PAGE = 'page'

#: What the page has in addition, before viser's own code.
_HEAD = (Path(__file__).parent / 'head.html').read_text()
_SERVE = websockets.asyncio.server.serve


class Server(viser.ViserServer):
    """A server whose viewers can only look at the scene and use the panel."""

    title = ''  #: of the page, after 'TF: '

    def __init__(self, listening: socket.socket, why_refused: Callable[['Headers'], str]) -> None:
        """Start; `why_refused` returns why a request with these headers is refused, or ''."""
        self._listening, self._why_refused, self._is_guarded = listening, why_refused, False
        self._next_line = 0.0  # of the log (s, monotonic clock)
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
            response = process_request(connection, request)
            if response and response.headers.get('Content-Encoding') == 'gzip':
                page = with_head(gzip.decompress(response.body).decode(), self.title)
                response.body = gzip.compress(page.encode())
                del response.headers['Content-Length']
                response.headers['Content-Length'] = str(len(response.body))
            return response

        async def handle(connection: Any) -> None:
            try:
                await handler(connection)
            except Exception as error:  # bytes that are no message, or one that cannot be sent
                self._log(error)
                raise

        return _SERVE(handle, **{**kwargs, 'sock': self._listening, 'process_request': process,
                                 'max_size': LONGEST})

    def _guard_messages(self, receiver: Any) -> None:
        """Let a message that is not allowed, or whose handler fails, end its session."""
        handle = receiver._handle_incoming_message

        async def handle_or_end(client_id: int, message: Any) -> None:
            try:
                _check(message)
                if hasattr(message, 'updates') and (control := self._control(client_id, message)):
                    message.updates['value'] = _fitted(control, message.updates['value'])
                await handle(client_id, message)
            except Exception as error:
                self.end_session(client_id, error)

        receiver._handle_incoming_message = handle_or_end
        receiver.get_message_buffer().message_event = _LoopEvent()

    def _control(self, client_id: int, message: Any) -> Any:
        """Return the control that a message changes; None: it has been removed."""
        client = self.get_clients().get(client_id)
        return client and client.gui._gui_input_handle_from_uuid.get(message.uuid)

    def end_session(self, client_id: int, error: Exception) -> None:
        """Disconnect a viewer whose data have raised an error."""
        self._log(error)
        if connection := self._websock_server._live_connections.get(client_id):
            asyncio.run_coroutine_threadsafe(
                connection.close(1008), self.get_event_loop())  # policy violation

    def _log(self, error: Exception) -> None:
        logger, now = logging.getLogger(__name__), monotonic()
        if now >= self._next_line:
            self._next_line = now + _LOG_PERIOD
            logger.warning('a viewer is disconnected: %s', visible(abbreviated(
                f'{type(error).__name__}: {error}', _LONGEST_REASON)))
        logger.debug('a viewer is disconnected', exc_info=error)


class _LoopEvent(asyncio.Event):
    """An event that is set by the thread of an event loop only: elsewhere, `set` has no effect."""

    def set(self) -> None:
        with suppress(RuntimeError):
            asyncio.get_running_loop()
            super().set()


def uuid_of(control: Any) -> str:
    """Return the name of a control in the messages of a client."""
    return str(control._impl.uuid)


def with_head(page: str, title: str) -> str:
    """Return viser's page with head.html in place of its title."""
    return page.replace('<title>Viser</title>', _HEAD.replace('TITLE', f'TF: {escape(title)}'))


def receive_at_once(client: viser.ClientHandle) -> None:
    """Let a client receive all messages of an update at once."""
    client._websock_connection.get_message_buffer().max_window_size = _LARGEST_UPDATE


def set_pose(node: viser.SceneNodeHandle, position: Any, wxyz: Any = None) -> None:
    """Set the position (m) of a node, and its rotation if one is given: tuples of floats."""
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
    if hasattr(message, 'updates') and message.updates.keys() != {'value'}:
        raise ValueError(message.updates)
    if hasattr(message, 'request_uuid') and not isinstance(message.value, (str, type(None))):
        raise ValueError(message)
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


def _fitted(control: Any, value: Any) -> Any:
    """
    Return a value for a control, within its range; ValueError: it is of another kind.

    While a viewer types, a browser sends numbers beyond the range, and corrects them at the end.
    """
    known = control.value
    if isinstance(known, (float, tuple)):
        numbers = np.array(value)
        if (numbers.dtype.kind not in 'iuf' or numbers.shape != np.shape(known)
                or not np.isfinite(numbers).all()):
            raise ValueError(f'{control.label} must be as {known}, got {value!r}')
        lower, upper = np.array([control.min, control.max], float)  # NaN: there is no limit
        return np.fmin(np.fmax(numbers, lower), upper).tolist()
    if type(value) is not type(known):
        raise ValueError(f'{control.label} must be a {type(known).__name__}, got {value!r}')
    return value


def _silence() -> None:
    # viser would print its address, and a line when it stops.
    rich.reconfigure(quiet=True)
    # viser would warn of messages to a client that has just disconnected, and of nonsense.
    warnings.filterwarnings('ignore', r'Queued a |\[viser\] ')
    # websockets would log each malformed request or message with a traceback.
    logging.getLogger('websockets').setLevel(logging.CRITICAL)
