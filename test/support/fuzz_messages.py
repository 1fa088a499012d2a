"""
Fuzz targets: the bytes of messages and of bags.

A target is a function that takes bytes and raises an exception if it finds a fault. `fuzz.py`
calls the targets with bytes that libFuzzer makes up; `test_fuzz.py`, with the seeds and with the
bytes that found a fault before. No target imports ROS before it is called.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack, suppress
from functools import cache
import json
import logging
from math import isfinite
from pathlib import Path
import random
import shutil
import struct
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Optional, Union
from xml.parsers import expat

import bags
from environment import DATA
from messages import golden_messages, written
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

from puretf import TransformBuffer
from puretf._core.pose import Row
from puretf._wire.encoding import CDR, MalformedMessage, ROS1
from puretf.bag import BagError, read
from puretf.bag import open as open_bag
from puretf_tools.robot.observed import parsed

S = 10**9
T = 1_700_000_000 * S
#: tf2_msgs/msg/TFMessage, and the same type with the bytes of each name in place of a string.
TF, TF_BYTES = 'tf2_msgs/msg/TFMessage', 'fuzz_msgs/msg/TFMessage'
_TIME = 'builtin_interfaces/msg/Time'
#: The length of texts, and of pieces of them that are repeated (bytes).
_LONGEST_TEXT, _STRETCHED = 4096, 1_000_000


_opened = ExitStack()


def close() -> None:
    """Remove the files of the targets; they can be called again."""
    _opened.close()
    for made in folder, seed_bag, _with_checksums:
        made.cache_clear()


class Input:
    """Values that are taken off the beginning of bytes; zeros, when all bytes are used up."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def __bool__(self) -> bool:
        """Whether bytes are left."""
        return self._at < len(self._data)

    def raw(self, size: int) -> bytes:
        """Take bytes; fewer than asked for at the end."""
        self._at += size
        return self._data[self._at - size:self._at]

    def integer(self, largest: int) -> int:
        """Take an integer from 0 to `largest`."""
        size = (largest.bit_length() + 7) // 8
        return int.from_bytes(self.raw(size), 'little') % (largest + 1)

    def choice(self, values: Sequence[Any]) -> Any:
        """Take one of some values."""
        return values[self.integer(len(values) - 1)]

    def text(self, longest: int = 40) -> str:
        """Take a text, as Python decodes the arguments of a program: with lone surrogates."""
        return self.raw(self.integer(longest)).decode('utf-8', 'surrogateescape')

    def number(self) -> float:
        """Take a number: small, or any float64, which may be NaN."""
        kind = self.integer(3)
        if kind == 0:
            return (self.integer(255) - 128) / 64
        if kind == 1:
            return float(self.choice((0.0, 1.0, -1.0, 1e300, 1e-300, 'inf', 'nan')))
        (number,) = struct.unpack('<d', self.raw(8).ljust(8, b'\0'))
        return float(number)


class Fields(NamedTuple):
    """The values of a transform that another implementation has read; the pose as 56 bytes."""

    sec: int
    nanosec: int
    names: tuple[Any, ...]  #: frame_id and child_frame_id, as bytes or as texts
    pose: bytes


@cache
def golden_rows() -> list[list[Row]]:
    """Return transforms that the real tf2 has received, one list for each of its buffers."""
    # Python's JSON writes NaN and infinity as these names, and reads them so.
    cases = json.loads((DATA / 'tf2_answers.json').read_text())
    return [[Row(op['stamp_ns'], op['parent'], op['child'], (*op['xyz'], *op['xyzw']))
             for op in case['ops'] if 'stamp_ns' in op] for case in cases]


@cache
def _types(version: int) -> Any:
    """Return rosbags' types of a version of ROS, and those with the bytes of each name."""
    types = get_typestore(Stores.ROS2_JAZZY if version == 2 else Stores.ROS1_NOETIC)
    seq = 'uint32 seq\n' if version == 1 else ''
    for name, definition in (
            ('fuzz_msgs/msg/Header', f'{seq}{_TIME} stamp\nuint8[] frame_id'),
            ('fuzz_msgs/msg/TransformStamped',
             'fuzz_msgs/msg/Header header\nuint8[] child_frame_id\n'
             'geometry_msgs/msg/Transform transform'),
            (TF_BYTES, 'fuzz_msgs/msg/TransformStamped[] transforms'),
            (TF, 'geometry_msgs/msg/TransformStamped[] transforms')):
        if name not in types.types:
            types.register(get_types_from_msg(definition, name))
    return types


def _read_by_rosbags(data: bytes, version: int, msgtype: str) -> Optional[tuple[Any, int]]:
    """
    Read a message by the code that rosbags has generated for its type.

    :returns: the transforms, and the number of bytes that were read; None if rosbags refuses it.
        Bytes after the end are not refused, which `deserialize_cdr` and `deserialize_ros1` do.
    """
    types = _types(version)
    definition = types.get_msgdef(msgtype)
    if version == 1:
        deserialize, head = definition.deserialize_ros1, 0
    else:
        if len(data) < 4 or data[0] or data[1] > 1:
            return None
        deserialize = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
        head = 4
    try:
        message, end = deserialize(data[head:], 0, definition.cls, types)
    except Exception:  # errors of many types
        return None
    return message.transforms, end + head


def _fields(transform: Any) -> Fields:
    """Return the values of a transform, as rosbags or rclpy have read it."""
    header, pose = transform.header, transform.transform
    xyz, xyzw = pose.translation, pose.rotation
    stamp, names = header.stamp, (header.frame_id, transform.child_frame_id)
    return Fields(
        getattr(stamp, 'sec', 0), stamp.nanosec,
        tuple(name.encode() if isinstance(name, str) else bytes(name) for name in names),
        struct.pack('<7d', xyz.x, xyz.y, xyz.z, xyzw.x, xyzw.y, xyzw.z, xyzw.w))


def check_cdr(data: bytes) -> None:
    """Read a message of ROS 2, and compare the values with those of rosbags and of Fast CDR."""
    try:
        ours = [Fields(*each[:2], each[2:4], struct.pack('<7d', *each[4]))
                for each in CDR.fields(data)]
    except MalformedMessage:
        # The other way round: of plain CDR, nothing is refused that others read.
        assert _read_by_rosbags(data, 2, TF_BYTES) is None, 'rosbags reads it'
        return
    assert CDR.unpack(data) or not ours
    answer = _read_by_rosbags(data, 2, TF_BYTES)
    assert answer, 'rosbags does not read it'
    raw = [_fields(each) for each in answer[0]]
    # Rule: a name ends at its first NUL or, without one, at the length that is given; what is not
    # valid UTF-8 is replaced. This is what rclpy does, see `_check_by_fast_cdr`.
    assert [each._replace(names=tuple(map(_text, each.names))) for each in raw] == ours
    # Rule: rosbags refuses a string without a NUL at its end, and invalid UTF-8; and it keeps
    # what is between the first and the last NUL. All other names are the same.
    if all(name[-1:] == b'\0' and name.count(b'\0') == 1 and '\ufffd' not in _text(name)
           for each in raw for name in each.names):
        answer = _read_by_rosbags(data, 2, TF)
        assert answer, 'rosbags does not read its strings'
        assert [_fields(each) for each in answer[0]] == [
            each._replace(names=tuple(name.encode() for name in each.names)) for each in ours]
    _check_by_fast_cdr(raw, ours, '<' if data[1] else '>')


def _text(name: bytes) -> str:
    return name.partition(b'\0')[0].decode('utf-8', 'replace')


def _check_by_fast_cdr(raw: list[Fields], ours: list[Fields], order: str) -> None:
    """Compare our values with those that rclpy reads, one message for each transform."""
    try:
        from geometry_msgs.msg import TransformStamped
        from rclpy.serialization import deserialize_message
    except ImportError:  # there is no ROS
        return
    for each, our in zip(raw, ours):
        body = struct.pack(order + 'iI', each.sec, each.nanosec)
        for name in each.names:
            body += bytes(-len(body) % 4) + struct.pack(order + 'I', len(name)) + name
        body += bytes(-len(body) % 8)
        body += each.pose if order == '<' else struct.pack('>7d', *struct.unpack('<7d', each.pose))
        theirs = _fields(deserialize_message(
            bytes([0, order == '<', 0, 0]) + body, TransformStamped))
        assert theirs == our._replace(names=tuple(name.encode() for name in our.names))


def seeds_of_cdr() -> Iterator[bytes]:
    """Yield golden messages, one of them big-endian, and one with odd strings."""
    yield from (bytes.fromhex(case['cdr_hex']) for case in golden_messages())
    yield written(golden_rows()[0][:2], '>')
    for name in b'', b'ab', b'a\0b\0', b'\xff\0', b'a/\xe6\x97\xa5\0', b'\xed\xa0\x80\0':
        body = struct.pack('<IiII', 1, 5, 2**32 - 1, len(name)) + name
        body += bytes(-len(body) % 4) + b'\1\0\0\0\0'
        yield b'\0\1\0\0' + body + bytes(-len(body) % 8) + struct.pack('<7d', *range(7)) + b'end'


def _stretched(data: bytes) -> bytes:
    """Repeat two pieces of some bytes, to about a MB each; after a byte 255 that asks for it."""
    if data[:1] != b'\xff':
        return data
    source = Input(data[1:])
    pieces = sorted((source.integer(_LONGEST_TEXT), 1 + source.integer(255)) for _ in range(2))
    rest = source.raw(_LONGEST_TEXT)
    for begin, size in reversed(pieces):
        piece = rest[begin:begin + size]
        rest = rest[:begin] + piece * (_STRETCHED // size) + rest[begin + size:]
    return rest


def _has_doctype(text: str) -> Optional[bool]:
    """Return whether expat sees a document type before the first element; None: it is broken."""
    found: list[object] = []
    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = lambda *_: found.append(0)
    parser.StartElementHandler = lambda *_: found.append(1)
    try:
        parser.Parse(text, True)
    except (expat.ExpatError, UnicodeError):
        if not found:
            return None
    return found[:1] == [0]


def check_description(data: bytes) -> None:
    """A URDF text is a tree of finite poses, or is refused with one line; a DOCTYPE always is."""
    text = _stretched(data).decode('utf-8', 'replace')
    robot = parsed(text)
    if len(text) <= _LONGEST_TEXT:
        is_refused = isinstance(robot, str) and 'has a <!DOCTYPE' in robot
        has_doctype = _has_doctype(text)
        assert is_refused or not (has_doctype and not isinstance(robot, str))
        assert has_doctype is not False or not is_refused
    if isinstance(robot, str):
        assert robot.isprintable()
        assert len(robot) < 2000
        return
    parents = {joint.child: joint.parent for joint in robot.joints}
    assert {robot.root, *parents} == {*robot.links}
    for link in robot.links:
        seen = {link}
        while link != robot.root:
            link = parents[link]
            assert link not in seen
            seen.add(link)
    poses = [joint.pose for joint in robot.joints]
    poses += [shape.pose for shape in (*robot.visuals, *robot.collisions)]
    poses += [joint.pose_at(0.5) for joint in robot.joints if joint.is_movable]
    assert all(isfinite(value) for pose in poses for value in pose)


def seeds_of_description() -> Iterator[bytes]:
    """Yield the arm and the recorded descriptions."""
    yield (DATA.parents[1] / 'dummy_arm/urdf/dummy_arm.urdf').read_bytes()
    yield b'<?a?><!-- <!DOCTYPE -->\n<!DOCTYPE robot [<!ATTLIST link a CDATA "b">]><robot/>'
    yield b'<robot name="r"><link name="a"/><![CDATA[<!DOCTYPE robot>]]></robot>'
    text = (b'<robot name="r" xmlns="u"><link name="a"/><link name="b"/><joint name="n" '
            b'type="fixed"><parent link="a"/><child link="b"/><x/></joint></robot>')
    for pieces in ((b'<parent link="a"/>', b'<x/>'), (b'n"', b'<x/>'), (b'u"', b'<x/>'),
                   (b'<link name="a"/>', b'<child link="b"/>'), (b'r"', b'<link name="b"/>')):
        yield b'\xff' + b''.join(struct.pack('<HB', text.index(piece), len(piece.strip(b'"')) - 1)
                                 for piece in pieces) + text
    cases = json.loads((DATA / 'robot_state_publisher.json').read_text())['cases']
    yield from {case['urdf'].encode('utf-8', 'surrogatepass'): None for case in cases}


def check_ros1(data: bytes) -> None:
    """Read a message of ROS 1, and compare the values with those of rosbags."""
    answer = _read_by_rosbags(data, 1, TF_BYTES)
    try:
        rows = ROS1.unpack(data)
    except MalformedMessage:
        assert answer is None, 'rosbags reads it'
        return
    assert answer, 'rosbags does not read it'
    raw = [_fields(each) for each in answer[0]]
    stamps = [each.header.stamp for each in answer[0]]
    # Rules: seconds are unsigned, which rosbags reads as signed; a name ends at its first NUL;
    # what is not valid UTF-8 is replaced; bytes after the end are ignored.
    assert [(row.stamp_ns, row.frame_id, row.child_frame_id, struct.pack('<7d', *row.pose))
            for row in rows] == [
        (stamp.sec % 2**32 * S + stamp.nanosec,
         *map(_text, each.names), each.pose)
        for stamp, each in zip(stamps, raw)]
    if not any('\ufffd' in name.decode('utf-8', 'replace') for each in raw for name in each.names):
        answer = _read_by_rosbags(data, 1, TF)
        assert answer, 'rosbags does not read its strings'
        assert [_fields(each) for each in answer[0]] == raw


def seeds_of_ros1() -> Iterator[bytes]:
    """Yield the transforms of golden data as messages of ROS 1."""
    for rows in golden_rows()[:12]:
        yield written(rows[:4], encoding=ROS1)
    yield written([Row(T, '\0', '日本\x1b', bags.STILL)], encoding=ROS1) + b'end'


# Bags


@contextmanager
def logged_texts() -> Iterator[list[str]]:
    """Record what the package logs; fail if it is a traceback, as it is if there is a bug."""
    records: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: records.append(  # type: ignore[method-assign]
        record.getMessage())
    logger = logging.getLogger('puretf')
    logger.addHandler(handler)
    propagates, logger.propagate = logger.propagate, False
    try:
        yield records
    finally:
        logger.propagate = propagates
        logger.removeHandler(handler)
    for text in records:
        assert 'Traceback' not in text, text


def _state(buffer: TransformBuffer) -> dict[str, str]:
    """Return all data of a buffer, as texts, since a NaN is not equal to itself."""
    return {name: str(known) for name, known in buffer.dump().items()}


_BAG_MESSAGES = [
    ('/tf_static', 100 * S, [Row(100 * S, 'map', 'odom', bags.STILL)]),
    *(('/tf', (100 + i) * S, [Row((100 + i) * S, 'odom', 'base_link', (i, *bags.STILL[1:])),
                              Row((100 + i) * S, 'base_link', 'tool', bags.STILL)])
      for i in range(3))]
KINDS = (*bags.ROS2, *bags.ROS1, 'mcap chunk', 'mcap bit')
#: The largest decompressed size that is allowed (bytes).
_MAX_BYTES = 2**22
_INTERESTING = (b'\0', b'\xff', b'\0' * 8, b'\xff' * 8, b'\x7f\xff\xff\xff', b'\xff\xff\xff\x7f')


@cache
def folder() -> Path:
    """Return a temporary directory of this process."""
    return Path(_opened.enter_context(TemporaryDirectory(prefix='fuzz')))


@cache
def seed_bag(kind: str) -> dict[str, bytes]:
    """Return the files of a small bag, by name; the first one is the bag itself, if it is one."""
    path = folder() / 'seed'
    state = random.getstate()
    random.seed(0)  # bags.py numbers the messages of ROS 1 at random
    point = bags.point('laser', version=1 if kind.startswith('bag') else 2)
    made = bags.make(path, kind, [
        *_BAG_MESSAGES, ('/point', 105 * S, point, 'geometry_msgs/msg/PointStamped')])
    random.setstate(state)
    if made.is_file():
        files = {'x.bag': made.read_bytes()}
        made.unlink()
    else:
        files = {each.name: each.read_bytes()
                 for each in sorted(made.iterdir(), key=lambda each: each.suffix == '.yaml')}
        shutil.rmtree(made)
    return files


def _chunk_content() -> bytes:
    """Return the records in a chunk of mcap, which are changed before the chunk is compressed."""
    return b''.join([
        bags.mcap_channel(), bags.mcap_channel('/tf_static', 2), *(
            bags.mcap_message(bags.ros2(rows), time, 2 if topic == '/tf_static' else 1)
            for topic, time, rows in _BAG_MESSAGES)])


def changed(data: bytes, source: Input) -> bytes:
    """Change bytes at places: overwrite, insert, cut off, remove or repeat."""
    changed = bytearray(data)
    for _ in range(8):
        if not source:
            break
        op, at = source.integer(7), source.integer(max(1, len(changed)))
        if op <= 2:
            new = source.raw(1 + source.integer(15))
            changed[at:at + (len(new) if op else 0)] = new
        elif op == 3:
            new = source.choice(_INTERESTING)
            changed[at:at + len(new)] = new
        elif op == 4:
            del changed[at:]
        elif op == 5:
            del changed[at:at + source.integer(2**16)]
        elif op == 6:
            part = changed[at:at + source.integer(2**12)]
            changed[at:at] = part
        elif at < len(changed):  # a bit
            changed[at] ^= 1 << source.integer(7)
    return bytes(changed)


@cache
def _with_checksums() -> bytes:
    return bytes(bags.checked_mcap(folder() / 'checked', compression='ZSTD').read_bytes())


def _check_bit(path: Path, source: Input) -> None:
    """Flip a bit. Rule: the file is refused, or all is read as without it."""
    data = _with_checksums()
    path.write_bytes(data)
    bags.flips(path, [8 * source.integer(len(data) - 1) + source.integer(7)])
    bags.content(path, True)


def check_bags(data: bytes) -> None:
    """Change bytes of a bag and read it: it is read, or a BagError says in one line why not."""
    source = Input(data)
    kind = source.choice(KINDS)
    bag = path = folder() / 'bag'
    try:
        if kind == 'mcap bit':
            _check_bit(path, source)
            return
        if kind == 'mcap chunk':
            method = source.choice(('', 'lz4', 'zstd'))
            bags.mcap(path, bags.mcap_channel(), bags.mcap_chunk(
                changed(_chunk_content(), source), method))
        else:
            files, how = dict(seed_bag(kind)), source.integer(3)
            name = list(files)[how % 2 if len(files) > 1 else 0]
            files[name] = changed(files[name], source)
            path.mkdir()
            for each, content in files.items():
                if how or each == name:
                    (path / each).write_bytes(content)
            if not how or len(files) == 1:  # the file of the bag alone, without its metadata
                bag = path / name
        with logged_texts() as logged:
            whole = _read_bag(bag, False)
            count = len(logged)
            in_parts = _read_bag(bag, True)
        # Rule: a file of mcap without an index is read in the same way with partial=True; if it
        # is refused without partial=True, it is not read without a warning.
        if kind == 'mcap chunk':
            assert in_parts == whole if isinstance(whole, dict) else (
                isinstance(in_parts, str) or logged[count:]), (whole, in_parts)
    finally:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def _read_bag(path: Path, partial: bool) -> Union[dict[str, str], str]:
    """Read a bag; return the data of the buffer, or why the bag is refused."""
    if not partial:
        with suppress(BagError), open_bag(path, partial=True, max_bytes=_MAX_BYTES) as bag:
            for message in bag.messages(headers=True):
                with suppress(MalformedMessage):
                    message.rows()
    try:
        return _state(read(path, partial=partial, max_bytes=_MAX_BYTES))
    except BagError as error:
        text = str(error)
    assert text.isprintable(), repr(text)
    assert 0 < len(text) < 5000
    return text


def seeds_of_bags() -> Iterator[bytes]:
    """Yield every kind of bag: unchanged, with its metadata, cut off, and overwritten."""
    for number, kind in enumerate(KINDS):
        yield bytes([number])
        yield bytes([number, 2])
        yield bytes([number, len(kind) % 4, 4, 200, 3])
        yield bytes([number, 0, 3, 0, 5, 1, 1, 9, 4, 2, 1, 2, 3])
        yield bytes([number, 30, *range(30)])
    yield bytes([0, 1, 1, 9, 0, 1]) + b'[{'  # in the metadata
