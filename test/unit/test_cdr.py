"""The CDR encoding of TFMessage."""

import struct

from hypothesis import given
from hypothesis import strategies as st
from messages import golden_fields, golden_messages, golden_rows, written
import numpy as np
import pytest

from puretf._core.pose import Row
from puretf._wire import cdr
from puretf._wire.encoding import CDR, MalformedMessage
from puretf._wire.message_reader import Layout

S = 10**9
IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
names = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'))
numbers = st.floats(allow_nan=False)
seconds = st.integers(-2**31, 2**31 - 1)
rows = st.builds(Row, st.integers(-2**31 * S, 2**31 * S - 1), names, names,
                 st.tuples(*[numbers] * 7))


def test_packs_as_the_real_type_support():
    """The golden transforms are packed into the golden bytes."""
    for case in golden_messages():
        assert cdr.pack_fields(golden_fields(case)).hex() == case['cdr_hex']
        if all(nanosec < S for _, nanosec, *_ in golden_fields(case)):
            assert cdr.pack(golden_rows(case)).hex() == case['cdr_hex']


def test_unpacks_as_the_real_type_support():
    """The golden bytes are unpacked into the golden transforms."""
    for case in golden_messages():
        data = bytes.fromhex(case['cdr_hex'])
        assert CDR.unpack(data) == golden_rows(case)
        assert [*CDR.fields(data)] == golden_fields(case)


def test_a_message_annotated():
    """A message of one transform has exactly the bytes that are explained here."""
    row = Row(S + 2, 'map', 'tool', (1.0, *IDENTITY[1:]))
    assert cdr.pack([row]).hex(' ', 4) == (
        '00010000 '          # encapsulation: little endian
        '01000000 '          # one transform
        '01000000 02000000 '           # sec, nanosec
        '04000000 6d617000 '           # 'map' and NUL
        '05000000 746f6f6c 00000000 '  # 'tool', NUL, padding up to the next multiple of 8
        '00000000 0000f03f 00000000 00000000 00000000 00000000 '                    # x y z
        '00000000 00000000 00000000 00000000 00000000 00000000 00000000 0000f03f')  # x y z w


@given(st.sampled_from('<>'), st.data())
def test_either_byte_order(order, data):
    """Big-endian messages are read, too, and nanoseconds may be more than a second."""
    transforms = data.draw(st.lists(rows, max_size=5))
    stamps = [data.draw(st.tuples(seconds, st.integers(0, 2**32 - 1))) for _ in transforms]
    unpacked = CDR.unpack(written(transforms, order, stamps=stamps))
    assert unpacked == [row._replace(stamp_ns=sec * S + nanosec)
                        for row, (sec, nanosec) in zip(transforms, stamps)]
    assert {*map(type, unpacked)} <= {Row}


def test_every_prefix_is_malformed():
    """A truncated message is refused, wherever it ends."""
    for case in golden_messages():
        data = bytes.fromhex(case['cdr_hex'])
        for end in range(len(data)):
            with pytest.raises(MalformedMessage):
                CDR.unpack(data[:end])


@pytest.mark.parametrize(('position', 'number', 'error'), [
    (4, 2, '88 bytes cannot hold the 2 transforms'), (4, 2**32 - 1, '4294967295 transforms'),
    (16, 100, 'truncated'), (24, 2**32 - 1, 'truncated')])
def test_what_is_longer_than_the_message_is_malformed(position, number, error):
    """Billions of transforms, or a name of that length, are refused at once."""
    data = bytearray(cdr.pack([Row(0, 'map', 'tool', IDENTITY)]))
    data[position:position + 4] = struct.pack('<I', number)
    with pytest.raises(MalformedMessage, match=error):
        CDR.unpack(bytes(data))


@pytest.mark.parametrize('encapsulation', ['0003', '0007', 'ffff', '4142'])
def test_another_encoding_is_malformed(encapsulation):
    """Only plain CDR is read."""
    with pytest.raises(MalformedMessage, match='plain CDR'):
        CDR.unpack(bytes.fromhex(encapsulation) + bytes(6))


@pytest.mark.parametrize(('field', 'name'), [
    (b'\0\0\0\0', ''), (b'\5\0\0\0ab\0c\0\0\0\0', 'ab'), (b'\3\0\0\0\xff\xfe\0\0', '\ufffd\ufffd'),
    (b'\2\0\0\0ab\0\0', 'ab')])
def test_odd_strings_are_read_as_rclpy_does(field, name):
    """Strings without a NUL, with one inside, or that are no UTF-8 cause no error."""
    body = b'\1\0\0\0' + bytes(8) + field + b'\2\0\0\0c\0\0\0'
    body += bytes(-len(body) % 8) + bytes(56)
    assert CDR.unpack(b'\0\1\0\0' + body)[0][1:3] == (name, 'c')


def test_a_nul_in_a_name_is_refused():
    """C would silently cut off the name there."""
    with pytest.raises(ValueError, match=r"'a\\x00b' must not contain a NUL"):
        cdr.pack([Row(0, 'a\0b', 'c', IDENTITY)])


@given(st.lists(st.tuples(names, names), min_size=1, max_size=5), st.data())
def test_a_layout_packs_as_pack_does(edges, data):
    """A layout that is made once gives the same bytes."""
    stamp_ns = data.draw(st.integers(-2**31 * S, 2**31 * S - 1))
    poses = np.array(data.draw(st.lists(
        st.tuples(*[numbers] * 7), min_size=len(edges), max_size=len(edges))))
    assert Layout(CDR, edges).pack(stamp_ns, poses) == cdr.pack(
        [Row(stamp_ns, parent, child, pose)
         for (parent, child), pose in zip(edges, poses.tolist())])


@pytest.mark.parametrize('shape', [(7,), (2, 7), (1, 6), (1, 1), (0, 7)])
def test_a_layout_refuses_another_shape(shape):
    """Poses are not broadcast by numpy's rules, since each frame needs its own."""
    with pytest.raises(ValueError, match=r'shape \(1, 7\)'):
        Layout(CDR, [('a', 'b')]).pack(0, np.zeros(shape))


@pytest.mark.parametrize('stamp_ns', [2**31 * S, -2**31 * S - 1])
def test_a_stamp_that_does_not_fit_is_refused(stamp_ns):
    """Seconds are an int32 in the message, also in that of a layout."""
    for pack in (lambda: cdr.pack([Row(stamp_ns, 'a', 'b', IDENTITY)]),
                 lambda: Layout(CDR, [('a', 'b')]).pack(stamp_ns, np.zeros((1, 7)))):
        with pytest.raises(ValueError, match=(
                rf'stamp must be from -2\*\*31 to 2\*\*31 - 1 seconds, got {stamp_ns} ns')):
            pack()


@pytest.mark.parametrize('stamp_ns', [2**31 * S - 1, -2**31 * S, -1, 0])
def test_the_ends_of_what_fits(stamp_ns):
    """The first and the last stamp, and those around zero, are exact to the nanosecond."""
    row = Row(stamp_ns, 'a', 'b', IDENTITY)
    assert CDR.unpack(cdr.pack([row])) == [row]
    assert Layout(CDR, [('a', 'b')]).pack(stamp_ns, [IDENTITY]) == cdr.pack([row])


@given(*[st.text('ab_', min_size=1, max_size=254)] * 2, st.floats(allow_nan=False))
def test_the_key_of_a_message_has_both_names(parent, child, x):
    """Whatever their lengths, and nothing of what changes from message to message."""
    keys = [CDR.key(cdr.pack([Row(stamp, parent, child, (x * stamp, *IDENTITY[1:]))]))
            for stamp in (0, 1)]
    assert keys[0] == keys[1]
    assert keys[0].startswith(f'{parent}\0'.encode(), 4)
    assert keys[0].rstrip(b'\0').endswith(child.encode())
