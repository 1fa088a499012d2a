"""
Fuzz targets: names of frames in every text that shows them, and the page.

See fuzz_messages.py for what a target is.
"""

import atexit
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from functools import cache
from html import unescape
from html.parser import HTMLParser
from importlib import import_module
import io
import json
import logging
import math
import re
import socket
import struct
import threading
import time
from typing import Any, Optional

import bags
from environment import COMMANDS
from fuzz_messages import folder, Input, logged_texts, S, T

from puretf import TransformBuffer, TransformException
from puretf._core.frames import as_dot as frames_as_dot
from puretf._core.pose import Row
from puretf._text.names import LONGEST_NAME, shortened, visible
from puretf._wire import cdr
from puretf_tools.commands.tf2_monitor import format_traffic
from puretf_tools.commands.view_frames import format_tree
from puretf_tools.inspection.forest import Forest
from puretf_tools.inspection.graph import as_dot
from puretf_tools.inspection.traffic import NodeTraffic, Summary
from puretf_tools.view.details import details, overview
from puretf_tools.view.feed import BagFeed
from puretf_tools.view.placement import FrameWatcher

#: A line of a terminal may have this many characters: some names, abbreviated and then escaped.
_LONGEST_LINE = 8000
#: The logger of the sessions that end.
DISCONNECTED = 'puretf_tools.view.viser_private'


#: The settings of a view that a browser may have stored, and values that these can have.
RIGHT: dict[str, list[Any]] = {
    'Axis length (m)': [0.02, 1, 2.0], 'Frame timeout (s)': [1, 15.5, 60], 'Opacity': [0.1, 1],
    'Axes': [True, False], 'Grid': [False], 'Dark': [True], 'Follow its yaw': [True],
    'Show names': [None, False, True], 'Include': ['', 'a -b', r'(\w+)+!', '['],
    'Fixed frame': [None, '', 'base', 'nowhere', '<b>'],
    'Frame': ['map', '\n'], 'Trail of': ['base'], 'Follow': ['base'], 'A': ['map'], 'B': ['base'],
    'Hidden': [[], ['map', 'x']], 'Hidden branches': [['map']], 'Folded': [['map', 'base']],
    'Plot over': ['20 s', '2 min', 'whole bag'],
    'Camera': [[], [1, 2, 3, 0, 0, 0, 0.8], [0, 0, 0, 0, 0, 0, 3.1], [0, 0, 1e12, 0, 0, -1e12, 1]],
    'Time': [0, 1, 2**63 - 1]}


def run_command(name: str, arguments: Sequence[str]) -> tuple[object, str, str]:
    """Run a command in this process; return exit code, stdout and stderr, which must be UTF-8."""
    output, errors = (io.TextIOWrapper(io.BytesIO(), 'utf-8', 'strict') for _ in range(2))
    with redirect_stdout(output), redirect_stderr(errors):
        try:
            code = import_module(COMMANDS[name]).main([*arguments])
        except SystemExit as error:
            code = error.code
    for stream in output, errors:
        stream.flush()
    printed, reported = (stream.buffer.getvalue().decode() for stream in (output, errors))
    return code, printed, reported


def check_lines(text: str, longest: int = _LONGEST_LINE) -> None:
    """Check that lines can be printed to a terminal, and are not long."""
    for line in text.split('\n'):
        assert line.isprintable(), f'control characters: {line!r}'
        assert len(line) <= longest, f'{len(line)} characters: {line[:2000]!r}'


# Names


def _rows(source: Input) -> list[Row]:
    """Return transforms between frames with odd names, in which there may be loops."""
    names = [source.text(source.choice((8, 40, 255, 1100))).replace('\0', '') or 'x'
             for _ in range(1 + source.integer(5))]
    names += ['map', 'tool']
    return [Row(T + source.integer(3) * S, source.choice(names), source.choice(names),
                (source.number(), *bags.STILL[1:])) for _ in range(1 + source.integer(8))]


def check_names(data: bytes) -> None:
    """Show frames in every text: nothing in it is a control character or gets too long."""
    source = Input(data)
    rows = _rows(source)
    authority = source.text()
    buffer = TransformBuffer(2**63 - 1)
    with logged_texts() as records:
        for row in rows:
            buffer.insert(*row, authority, source.integer(3) == 0)
    for record in records:
        check_lines(record)
    frames = buffer.frames()
    names = list(dict.fromkeys(name for frame in frames for name in (frame.parent, frame.name)))
    ends = source.choice([*names, 'map']), source.choice([*names, 'tool'])
    _check_errors(buffer, names, ends)
    if frames:
        _check_graphs(buffer, frames, names)
        _check_page(buffer, frames, authority, source.choice([*names, 'no']))
    forest = Forest(frames)
    check_lines('\n'.join(format_tree(forest, T)))
    check_lines('\n'.join(format_traffic([
        NodeTraffic(name, authority, i % 2 == 0, i % 3 == 0,
                    Summary(1.0, 0.0, 0.0) if i else None, 1.0, i % 2)
        for i, name in enumerate([*names, *names, ''])])))
    _check_commands(rows, ends, source.integer(3))


def _check_errors(buffer: TransformBuffer, names: list[str], ends: tuple[str, str]) -> None:
    """Check the errors of lookups, and the texts of tf2_echo and tf2_monitor about them."""
    for target, frame in ends, ('map', 'nobody'), (ends[0], f'{ends[1]}x'):
        for stamp in 0, T + S // 2, T + 20 * S:
            try:
                buffer.lookup_transform(target, frame, stamp)
            except TransformException as error:
                text = str(error)
                # A loop has a line for each frame, as in tf2. In other errors, names that the
                # caller has not named are escaped and abbreviated.
                if 'exists with parent' not in text:
                    for own in sorted((target, frame), key=len, reverse=True):
                        text = text.replace(own, '')
                    check_lines(text, 3000)
        with suppress(TransformException):
            buffer.chain(target, frame)
        offline = _offline_listener()
        if offline is not None:
            listener = offline(buffer)
            why = listener.why_no_transform(target, frame)
            check_lines('\n'.join(map(visible, why.split('\n'))), 12_000)
            from puretf_tools.commands.tf2_monitor import Chain
            check_lines('\n'.join(Chain(listener, (target, frame)).lines()), 12_000)


@cache
def _offline_listener() -> Any:
    """Return a class of FrameListener with the frames of any buffer; None without ROS."""
    try:
        from puretf_tools.inspection.frame_listener import FrameListener
    except ImportError:
        return None
    from puretf import BufferCore

    class Offline(FrameListener):
        """A listener without a node, whose frames have all arrived."""

        buffer: Any = None

        def __init__(self, buffer: TransformBuffer) -> None:
            self.buffer = BufferCore()
            for frame in buffer.frames():
                self.buffer.insert(frame.latest, frame.parent, frame.name, bags.STILL,
                                   frame.authority, frame.is_static)
            self._start = 0.0

        def now(self) -> int:
            return T

        def topics_hint(self) -> str:
            return ''

        def why_nothing(self) -> str:
            return ''

    return Offline


def _check_graphs(buffer: TransformBuffer, frames: Any, names: list[str]) -> None:
    """Read the YAML and the graphs with other libraries: they have the same names."""
    known = _yaml_reader()(buffer.all_frames_as_yaml())
    assert known.keys() == {frame.name for frame in frames}
    for frame in frames:
        assert known[frame.name]['parent'] == frame.parent
        assert known[frame.name]['broadcaster'] == frame.authority
    try:
        from pygraphviz import AGraph
    except ImportError:
        return
    graph = AGraph(string=as_dot(Forest(frames), T))
    assert len(graph.edges()) == len(frames)
    labels = [unescape(re.sub(r'\\(.)', lambda found: found[1].replace('n', '\n'),
                              node.attr['label'])) for node in graph.nodes()]
    assert sorted(labels) == sorted(
        '\n'.join(shortened(line, LONGEST_NAME) for line in name.split('\n')) for name in names)
    # Rules for the graph of tf2's format, in which a name stands as it is: a backslash in an
    # identifier is doubled, and graphviz leaves it so; a name that begins with a percent sign is
    # one of graphviz's own, which pygraphviz cannot read; a lone surrogate is not UTF-8; and a
    # NUL, which no name from ROS 2 has, is the end of the text.
    dot = frames_as_dot(frames, names, T)
    if _encodable(dot) and '\0' not in dot and not any(name.startswith('%') for name in names):
        graph = AGraph(string=dot)
        identifiers = {name: name.replace('\\', '\\\\').replace('\n', '\\n') for name in names}
        assert {*map(str, graph.nodes())} == {*identifiers.values()}
        assert {(str(a), str(b)) for a, b in graph.edges()} == {
            (identifiers[frame.parent], identifiers[frame.name]) for frame in frames}


def _encodable(text: str) -> bool:
    return not any('\ud800' <= character <= '\udfff' for character in text)


@cache
def _yaml_reader() -> Any:
    try:
        return import_module('yaml').safe_load
    except ImportError:  # it comes with ROS; the other one, with what reads bags
        return import_module('ruamel.yaml').YAML(typ='safe', pure=True).load


class _Page(HTMLParser):
    """Reads a text of the page; it may have the elements that we write, and no others."""

    def __init__(self) -> None:
        super().__init__()
        self.text = ''

    def handle_starttag(self, tag: str, attrs: list[tuple[str, Optional[str]]]) -> None:
        assert tag in ('div', 'br', 'table', 'tr', 'th', 'td', 'b', 'span'), tag
        assert {name for name, _ in attrs} <= {
            'style', 'class', 'data-text', 'data-value', 'colspan', 'title'}
        values = dict(attrs)
        assert (values.get('data-value') or '').replace('-', '').isalpha() or (
            not values.get('data-value')), attrs

    def handle_data(self, data: str) -> None:
        self.text += data


def _check_page(buffer: TransformBuffer, frames: Any, authority: str, selected: str) -> None:
    """Check the texts of the panel of the page, and the labels."""
    feed = BagFeed(buffer, authority or 'bag')
    placement = FrameWatcher(buffer).placement('')
    texts = [('', overview(placement, feed, selected)), *(
        (name, details(placement, name, feed, feed.buffer))
        for name in [*placement.names[:3], selected])]
    for name, text in texts:
        check_lines(text, 60_000)
        page = _Page()
        page.feed(text)
        page.close()
        if name in placement.frames:
            assert visible(placement.frames[name].parent) in page.text
            assert visible(placement.frames[name].authority) in page.text


def _check_commands(rows: list[Row], ends: tuple[str, str], number: int) -> None:
    """Run commands that read bags, two for each number: what they print is fit for a terminal."""
    path = folder() / 'names.mcap'
    bags.mcap(path, bags.mcap_channel(), *(
        bags.mcap_message(cdr.pack([row]), row.stamp_ns + S // 100)
        for row in rows if _encodable(row.frame_id + row.child_frame_id)))
    lines = (('view_frames', '--text'), ('tf_doctor', '--json'), ('tf_doctor', '--', *ends),
             ('tf2_echo', '--', *ends), ('tf_doctor',), ('tf_trajectory', '--', *ends),
             ('check_arm',), ('view_frames', '--text', f'--root={ends[0]}'))
    for name, *options in lines[2 * number:2 * number + 2]:
        code, output, errors = run_command(name, [f'--bag={path}', *options])
        # Rule: rclpy refuses arguments that are not UTF-8.
        assert code in (0, 1) or not _encodable(''.join(options)), (code, output, errors)
        check_lines(output)
        check_lines(errors)
        if '--json' in options and output:
            json.loads(output)


def seeds_of_names() -> Iterator[bytes]:
    """Yield names with quotes, markup, escape sequences, bidirectional text, and long names."""
    for number, texts in enumerate(((b'base_link', b'odom'), (b'\x1b[2J\x1b]0;x\7', b'\n\r\t'),
                  ('\u202eabc\u2066 \u200b'.encode(), b"it's"), (b'"}\\', b'<script>&amp;'),
                  (b'\xff\xfe\x80', '日本 é'.encode()), (b'{a: [b]}', b'# - ? :'),
                  (b'null', b'"\\"'), (b"'a\\n'", b'a\n'), (b'x' * 1000, b'x' * 999 + b'y'),
                  (b'a->b', b'; subgraph {'), (b'%s %d {0}', b'\\N \\G \\l'))):
        data = bytes([1])
        for text in texts:
            data = data + (struct.pack('<BB', 1, len(text)) if len(text) <= 40 else
                           struct.pack('<BH', 3, len(text))) + text
        edges = bytes([1, 2, 0, 0, 192]) + bytes([2, 0, 1, 0, 128]) + bytes([0, 2, 0, 0, 192])
        yield data + bytes([2]) + edges + b'\4node' + bytes([
            1, 1, 1, 1, 0, 1, 1, number])


# WebSocket messages


class _Server:
    """A page that shows a few frames, and what the process logs, prints and raises meanwhile."""

    def __init__(self) -> None:
        """Start to serve."""
        from viewer import Viewer
        import viser
        import viser._messages as viser_messages

        from puretf_tools.view.view import View
        from puretf_tools.view.viser_private import Server
        self.faults: list[str] = []
        self.refused: list[str] = []  #: why viser's thread has ended sessions
        self._before = threading.excepthook
        threading.excepthook = lambda args: self.faults.append(f'a thread died: {args}')
        self._handler = logging.Handler()
        self._handler.emit = self._note  # type: ignore[method-assign]
        logging.getLogger().addHandler(self._handler)
        # Of each session that ends: what the thread of viser refuses is no fault.
        logging.getLogger(DISCONNECTED).setLevel(logging.DEBUG)
        listening = socket.create_server(('127.0.0.1', 0))
        self.server = Server(listening, lambda headers: '')
        self.port = self.server.get_port()
        buffer = TransformBuffer(2**63 - 1)
        for i, name in enumerate(('arm', 'tool', '\x1b[2J', '<b>')):
            for stamp in T, T + S:
                buffer.insert(stamp, 'map', name, (float(i), *bags.STILL[1:]), 'node')
        self.view = View(BagFeed(buffer, 'bag'), self.server)
        self.view.update()
        self.protocol = f'viser-v{viser.__version__}'
        self.types = sorted(
            name for name, each in vars(viser_messages).items()
            if isinstance(each, type) and issubclass(each, viser_messages.Message))
        self.fields = {name: [*getattr(viser_messages, name).__annotations__]
                       for name in self.types}
        # All viewers have these.
        self.server.gui.add_text('', '')
        self.server.gui.add_slider('Time (s)', 0.0, 1.0, 0.01, 0.0)
        self.uuids = [*self.server.gui._gui_input_handle_from_uuid]
        self.slider = next(uuid for uuid in self.uuids if self.control(uuid).label == 'Time (s)')
        self.valid = {
            'GuiUpdateMessage': {'uuid': self.slider, 'updates': {'value': 0.5}},
            'ViewerCameraMessage': {
                'wxyz': [1.0, 0.0, 0.0, 0.0], 'position': [0.0, 0.0, 1.0], 'fov': 1.0,
                'near': 0.1, 'far': 100.0, 'image_height': 600, 'image_width': 800,
                'look_at': [0.0, 0.0, 0.0], 'up_direction': [0.0, 0.0, 1.0]},
            'SceneNodeClickMessage': {
                'name': '/world/frames', 'instance_index': 1, 'ray_origin': [0.0, 0.0, 0.0],
                'ray_direction': [0.0, 0.0, 1.0], 'screen_pos': [0.5, 0.5], 'modifier': None,
                'owner': ''}}
        self.values = {uuid: self.control(uuid).value for uuid in self.uuids}
        #: A viewer that only looks, and must not suffer.
        self.other = Viewer(self.port)
        end = time.monotonic() + 20
        while not self.server.get_clients():
            assert time.monotonic() < end
            time.sleep(0.001)
        self.view.update()  # creates its panel
        self.threads = {*threading.enumerate()}

    def _note(self, record: logging.LogRecord) -> None:
        text = logging.Formatter().format(record)
        if record.name == DISCONNECTED and record.thread != threading.main_thread().ident:
            self.refused.append(text)
        elif record.name == DISCONNECTED or record.levelno >= logging.WARNING:
            self.faults.append(text)

    def paste(self, text: str) -> tuple[str, str]:
        """Paste a view into the page of the other viewer; return the answer, and the view then."""
        viewer = self.other
        viewer.until(lambda: any(props.get('label') == 'Publish' for props in viewer.gui.values()),
                     self.view.update)
        viewer.press('R')
        viewer.set('Paste view', ' ')  # is received after the key
        viewer.until(lambda: not viewer.value('Paste view'), self.view.update)
        viewer.set('Paste view', text)
        viewer.until(lambda: not viewer.value('Paste view'), self.view.update)
        for shown in self.view.viewers.values():
            viewer.until(lambda: not shown.pace.is_waiting)  # noqa: B023
        self.view.update()
        answer = viewer.text('paste')
        viewer.act('kept', 'copy view')
        viewer.until(lambda: viewer.text('view'), self.view.update)
        return answer, unescape(re.findall(
            'data-text="view"[^>]*>([^<]*)<', viewer.text('view'))[0])

    def client(self) -> Any:
        """Return a new connection."""
        from websockets.sync.client import connect
        return connect(f'ws://127.0.0.1:{self.port}', subprotocols=[self.protocol], proxy=None,
                       max_size=None, max_queue=None, close_timeout=0.1, ping_interval=None)

    def check(self, sending: Any) -> None:
        """Check that the page goes on, and has ended at most the connection of one client."""
        import msgspec
        from websockets.exceptions import ConnectionClosed
        with suppress(TimeoutError):
            while True:
                self.other.receive(0)
        value = 0.5 if self.control(self.slider).value != 0.5 else 1.0
        message = msgspec.msgpack.encode({
            'type': 'GuiUpdateMessage', 'uuid': self.slider, 'updates': {'value': value}})
        end = time.monotonic() + 20
        try:
            sending.send(message)
            while self.control(self.slider).value != value:
                assert time.monotonic() < end, 'a valid message has no effect'
                with suppress(TimeoutError):
                    sending.recv(timeout=0.0005)
        except ConnectionClosed:
            with self.client() as fresh:
                fresh.send(message)
                while self.control(self.slider).value != value:
                    assert time.monotonic() < end, 'a valid message of another has no effect'
                    time.sleep(0.0005)
        self.view.update()
        self.other.receive(20)  # it shows another time
        while wrong := [control.label for uuid, first in self.values.items()
                        if type((control := self.control(uuid)).value) is not type(first)
                        or (isinstance(first, float) and not math.isfinite(control.value))]:
            assert time.monotonic() < end, f'no update corrects the value of {wrong}'
            self.view.update()

    def control(self, uuid: str) -> Any:
        """Return a control of the panel."""
        return self.server.gui._gui_input_handle_from_uuid[uuid]

    def close(self) -> None:
        """Stop to serve."""
        self.other.close()
        self.server.stop()
        threading.excepthook = self._before
        logging.getLogger().removeHandler(self._handler)


@cache
def page() -> Any:
    """Return the page of this process."""
    with redirect_stdout(io.StringIO()):
        server = _Server()
    atexit.register(close_page)
    return server


def close_page() -> None:
    """Stop to serve, if the page has been started."""
    if page.cache_info().currsize:
        page().close()
        page.cache_clear()


def _structure(source: Input, served: Any, depth: int = 3) -> Any:
    """Return a value that msgpack can write."""
    kind = source.integer(11)
    if kind < 3 or (depth == 0 and kind > 8):
        return source.number()
    if kind == 3:
        return source.integer(2**63 - 1) - source.integer(2**63 - 1)
    if kind == 4:
        return source.text().encode('utf-8', 'replace').decode()
    if kind == 5:
        return source.raw(source.integer(64))
    if kind == 6:
        return source.choice((None, True, False, float('nan'), float('inf'), 10**18, '', 'map'))
    if kind == 7:
        return source.choice(served.uuids)
    if kind == 8:
        return [source.number() for _ in range(source.choice((2, 3, 4, 7)))]
    if kind == 9:
        return [_structure(source, served, depth - 1) for _ in range(source.integer(4))]
    return {source.choice(('value', 'type', 'uuid', 'visible', 'a')): _structure(
        source, served, depth - 1) for _ in range(source.integer(4))}


def _message(source: Input, served: Any) -> Any:
    """Return a message as viser's page sends it, with other values, or another structure."""
    kind = source.integer(7)
    if kind == 0:
        return _structure(source, served)
    if kind < 4:
        return {'type': 'GuiUpdateMessage', 'uuid': source.choice(served.uuids),
                'updates': {source.choice(('value', 'value', 'visible', 'options', 'on_update')):
                            _structure(source, served)}}
    name = source.choice([*served.valid, *served.types] if kind == 7 else [*served.valid])
    message = {'type': name, **served.valid.get(name, dict.fromkeys(served.fields[name], 0))}
    for _ in range(source.integer(3)):
        message[source.choice([*message])] = _structure(source, served)
    if source.integer(15) == 1:
        message.pop(source.choice([*message]))
    return message


def check_websocket(data: bytes) -> None:
    """Send messages to the page: it serves its clients after that, and prints nothing."""
    import msgspec
    from websockets.exceptions import ConnectionClosed, WebSocketException
    source, served = Input(data), page()
    served.faults.clear()
    with redirect_stdout(io.StringIO()) as output, redirect_stderr(output):
        kind = source.integer(9)
        if kind == 0:  # no WebSocket at all
            with socket.create_connection(('127.0.0.1', served.port), timeout=10) as connection:
                connection.sendall(source.raw(2000))
        elif kind == 1:  # bytes that are no frames
            with suppress(WebSocketException, OSError), served.client() as client:
                client.socket.sendall(source.raw(2000))
                client.socket.shutdown(socket.SHUT_WR)
        with suppress(ConnectionClosed), served.client() as sending:
            with suppress(ConnectionClosed):
                for _ in range(32):
                    if not source or kind < 2:
                        break
                    form = source.integer(7)
                    sending.send(source.raw(500) if form == 0 else source.text(255).encode(
                        'utf-8', 'replace').decode() if form == 1 else
                        msgspec.msgpack.encode(_message(source, served)))
            served.check(sending)
    faults = [*served.faults, *filter(None, [output.getvalue()])]
    assert not faults, '\n'.join(faults)
    dead = [thread.name for thread in served.threads if not thread.is_alive()]
    assert not dead, f'threads have ended: {dead}'


def seeds_of_websocket() -> Iterator[bytes]:
    """Yield messages of the page, with right and wrong values, and other bytes."""
    yield b'\0GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n'
    yield b'\1\x81\x85\0\0\0\0hello\xff\xff'
    values = (b'\0\0\200', b'\6\0', b'\6\3', b'\4\4text', b'\5\4text', b'\7\2',
              b'\10\1\0\0\1\0\2\0\3', b'\11\1\0\0\1', b'\12\2\0\6\1\3\6\2')
    for value in values:
        yield b'\2' + b''.join(
            bytes([7, 1, control, 0]) + value for control in range(12))
        yield b'\2' + b''.join(  # types of messages, and their fields
            bytes([7, 5, number, 1, field]) + value + b'\0'
            for number in range(3) for field in range(1, 9))
    yield b'\2\7\0\12\0'
    yield b'\2\0\xc1\xff\1\12anything'


def _view(source: Input) -> str:
    """Return a view as a line of JSON, with right and wrong values, or another text."""
    values: tuple[Any, ...] = (
        10**400, -10**400, math.nan, math.inf, -1e308, 2**63, -1, 0.5, None, True, '', '\ud800',
        'map', 'float', '20 s', 'x' * 1025, [], {}, [[]], ['\udcff'], ['map'], {'tree': []})

    def value(depth: int = 2) -> Any:
        kind = source.integer(5)
        if kind == 0:
            return source.number()
        if kind == 1:
            return source.text()
        if kind < 4 or not depth:
            return source.choice(values)
        return [value(depth - 1) for _ in range(source.integer(8))] if kind == 4 else {
            source.choice(('x', 'y', 'z')): value(depth - 1)
            for _ in range(source.integer(3))}

    if (kind := source.integer(15)) == 0:
        return source.raw(4096).decode('utf-8', 'replace')
    view = {}
    for _ in range(1 + source.integer(7)):
        name = source.choice([*RIGHT])
        view[name] = value() if source.integer(1) else source.choice(RIGHT[name])
        if isinstance(view[name], list) and view[name] and kind > 7:
            view[name] = [*view[name]]
            view[name][source.integer(len(view[name]) - 1)] = value()
    return json.dumps(view)


def check_views(data: bytes) -> None:
    """Paste a view: it is shown or refused in a line, the page goes on, and keeps a right view."""
    from websockets.exceptions import ConnectionClosed

    from puretf_tools.view.settings import Settings
    served, text = page(), _view(Input(data)) or ' '
    served.faults.clear()
    served.refused.clear()
    with redirect_stdout(io.StringIO()) as output, redirect_stderr(output):
        try:
            answer, kept = served.paste(text)
        except ConnectionClosed as error:
            raise AssertionError('\n'.join([text, *served.faults, *served.refused])) from error
    check_lines(answer)
    assert len(answer) < 1000, answer
    json.loads(kept, parse_constant=lambda name: 1 / 0)
    assert Settings().restore(kept) == '', kept
    faults = [*served.faults, *filter(None, [output.getvalue()])]
    assert not faults, '\n'.join(faults)


def seeds_of_views() -> Iterator[bytes]:
    """Yield each setting with a right value, with others, and a text that is no view."""
    yield b'\0[1]'
    for number in range(len(RIGHT)):
        yield bytes([1, 0, number, 0, 0])
        for kind in range(2, 6):
            yield bytes([9, 1, number, 1, kind, number, number, 0, 1, kind % 4])
