"""The command `static_transform_publisher`: both styles of arguments, and their errors."""

from math import cos, pi, sin
import re
import signal

from conftest import tool
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile

from dummy_arm.cli.parser import UsageError
from dummy_arm.tf import TFMessage
from dummy_arm.tools import static_transform_publisher

NAME = 'static_transform_publisher'
FRAMES = ['--frame-id', 'map', '--child-frame-id', 'base']


def publish(ros, start, *arguments):
    """Run the command; return its process, and the only transform that it publishes."""
    process = start(*tool(NAME, *arguments))
    messages: list[TFMessage] = []
    ros.node.create_subscription(
        TFMessage, '/tf_static', messages.append,
        QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    ros.until(lambda: messages)
    (transform,) = messages[0].transforms
    return process, transform


def numbers(transform):
    """Return the translation (m) and the quaternion x, y, z, w."""
    t, r = transform.transform.translation, transform.transform.rotation
    return [t.x, t.y, t.z, r.x, r.y, r.z, r.w]


@pytest.mark.parametrize(('arguments', 'expected'), [
    (FRAMES, [0, 0, 0, 0, 0, 0, 1]),
    (['--x', '-1e-3', '--y', '-.5', '--z', '-2', *FRAMES], [-0.001, -0.5, -2, 0, 0, 0, 1]),
    (['--yaw', '-1.5', *FRAMES], [0, 0, 0, 0, 0, sin(-0.75), cos(-0.75)]),
    (['--pitch=1e-1', *FRAMES], [0, 0, 0, 0, sin(0.05), 0, cos(0.05)]),
    (['--qx', '0', '--qy', '0', '--qz', '-6e-1', '--qw', '0.8', *FRAMES],
     [0, 0, 0, 0, 0, -0.6, 0.8]),
    (['--qz', '0.708', '--qw', '0.707', *FRAMES],
     [0, 0, 0, 0, 0, 0.708 / (0.708**2 + 0.707**2)**0.5, 0.707 / (0.708**2 + 0.707**2)**0.5]),
])
def test_new_style(ros, start, arguments, expected):
    """Options accept negative numbers and exponents, and a quaternion of nearly unit length."""
    process, transform = publish(ros, start, *arguments)
    assert numbers(transform) == pytest.approx(expected, abs=1e-12)
    assert (transform.header.frame_id, transform.child_frame_id) == ('map', 'base')
    assert 'deprecated' not in process.output


@pytest.mark.parametrize(('arguments', 'expected'), [
    # The angles are yaw, pitch and roll, in this order: quarter turns about z, y and x.
    ('1 2 3 1.5707963267948966 0 0 /map base', [1, 2, 3, 0, 0, 0.5**0.5, 0.5**0.5]),
    ('-1 -2e0 -.5 0 1.5707963267948966 0 map /base', [-1, -2, -0.5, 0, 0.5**0.5, 0, 0.5**0.5]),
    ('0 0 0 0 0 -1.5707963267948966 /map /base', [0, 0, 0, -0.5**0.5, 0, 0, 0.5**0.5]),
    ('0 0 0 0 0 0.6 0.8 map base', [0, 0, 0, 0, 0, 0.6, 0.8]),
    ('0 0 0 0 0 0 -1 map base', [0, 0, 0, 0, 0, 0, -1]),
])
def test_old_style(ros, start, arguments, expected):
    """The old style is deprecated; leading slashes are published."""
    process, transform = publish(ros, start, *arguments.split())
    assert numbers(transform) == pytest.approx(expected, abs=1e-12)
    assert [transform.header.frame_id, transform.child_frame_id] == arguments.split()[-2:]
    process.line_with('Old-style arguments are deprecated; see --help for new-style arguments')


def test_its_output_and_its_parameters(ros, start):
    """It prints tf2's lines; its name is unique; its parameters are read-only."""
    process = start(*tool(NAME, '--x', '1', *FRAMES, '--ros-args', '-p', 'translation.x:=5.0'))
    other = start(*tool(NAME, '--frame-id', 'map', '--child-frame-id', 'other'))
    process.line_with('Spinning until stopped - publishing transform')
    assert process.line() == "translation: ('1.000000', '0.000000', '0.000000')\n"
    assert process.line() == "rotation: ('0.000000', '0.000000', '0.000000', '1.000000')\n"
    assert process.line() == "from 'map' to 'base'\n"
    other.line_with('Spinning')
    names = [re.findall(f'{NAME}_[A-Za-z0-9]{{16}}', each.output)[0] for each in (process, other)]
    assert names[0] != names[1]
    listing = start(*tool('param', names[0]))
    assert listing.exit_code() == 0
    for line in ('frame_id: map', 'child_frame_id: base', 'translation.x: 1.0', 'rotation.w: 1.0',
                 'rotation.x: 0.0'):
        assert f'{line}\n' in listing.output
    setting = start(*tool('param', names[0], 'translation.x', '2.0'))
    assert setting.exit_code() == 1
    assert 'read-only' in setting.output
    assert process.end(signal.SIGINT) < 5.0
    assert process.exit_code() == 0
    assert 'Traceback' not in process.output


@pytest.mark.parametrize(('arguments', 'message'), [
    # tf2 aborts with a core dump:
    (['--frame-id', 'map', '--child-frame-id', 'map'], "from 'map' to 'map': a frame cannot be"),
    (['--frame-id', '/map', '--child-frame-id', 'map'], "from '/map' to 'map': a frame cannot be"),
    (['0', '0', '0', '0', '0', '0', 'map', 'map'], "from 'map' to 'map': a frame cannot be"),
    # tf2 publishes them without a warning:
    (['--qw', '0', *FRAMES], '0 0 0 0 is not a rotation; the identity is 0 0 0 1'),
    (['0', '0', '0', '0', '0', '0', '0', 'map', 'base'], '0 0 0 0 is not a rotation'),
    (['--qz', '1', *FRAMES], 'of the quaternion 0 0 1 1 must be 1, not 1.41421; '
                             'did you mean 0 0 0.707107 0.707107[?]'),
    (['--qw', 'nan', *FRAMES], "argument --qw: 'nan' is not finite"),
    (['--qw', '-inf', *FRAMES], "argument --qw: '-inf' is not finite"),
    (['--x', '-nan', *FRAMES], "argument --x: '-nan' is not finite"),
    (['0', '0', 'nan', '0', '0', '0', 'map', 'base'], "argument z: 'nan' is not finite"),
    # tf2 reads 1.0:
    (['--x', '1.0abc', *FRAMES], "argument --x: '1.0abc' is not a number"),
    (['--x', '1_0', *FRAMES], "argument --x: '1_0' is not a number"),
    (['0', '0', '0', '1,5', '0', '0', 'map', 'base'], "argument yaw: '1,5' is not a number"),
    (['--x', *FRAMES], 'argument --x: expected one argument'),
    # tf2 ignores the second one:
    (['--qw', '1', '--yaw', '0', *FRAMES], 'both quaternion and Euler rotations: --qw and --yaw'),
    (['--yaw', '1', '0', '0', '0', '0', '0', '0', 'map', 'base'], 'both new-style'),
    (['0', '0', '0', '0', '0', '0', 'map', 'base', '--x', '1'], 'both new-style .* and old-style'),
    ([], 'both --frame-id and --child-frame-id must be given'),
    (['--frame-id', 'map'], 'both --frame-id and --child-frame-id must be given'),
    (['--child-frame-id', 'map'], 'both --frame-id and --child-frame-id must be given'),
    (['--frame-id', '', '--child-frame-id', 'base'], 'Frame id must not be empty'),
    (['--frame-id', 'map', '--child-frame-id', '/'], 'Child frame id must not be empty'),
    (['--frame-id', 'a\udcff', '--child-frame-id', 'b'], 'must be valid Unicode'),
    (['1', '2', '3'], r'8 arguments \(x y z yaw pitch roll .*\) or 9 \(.*\), got 3'),
    (['1'], r'8 arguments \(x y z yaw pitch roll .*\) or 9 \(.*\), got 1'),
    ([*'0123456789', 'map', 'base'], r'8 arguments \(.*\) or 9 \(.*\), got 12'),
    (['--frame_id', 'map', '--child-frame-id', 'base'], r'--frame_id.*did you mean --frame-id\?'),
])
def test_wrong_use_is_one_line_and_exit_code_2(failed, arguments, message):
    """The line names the error, and often the remedy."""
    code, line = failed(static_transform_publisher.main, *arguments)
    assert code == 2
    assert re.fullmatch(f'{NAME}: .*{message}.*\n', line)


def test_equal_frames_are_no_crash(start):
    """The exit code is 2, and there is one line; tf2 ends with a core dump."""
    process = start(*tool(NAME, '--frame-id', 'map', '--child-frame-id', 'map'))
    assert process.exit_code() == 2
    assert process.output.count('\n') == 1


def test_help(start):
    """The help describes both styles, and has an example."""
    process = start(*tool(NAME, '--help'))
    assert process.exit_code() == 0
    for text in ('--child-frame-id', 'example: static_transform_publisher --z',
                 'x y z yaw pitch roll', 'radians'):
        assert text in process.output


def test_the_function_refuses_what_the_command_does():
    """It raises a UsageError before it creates a node."""
    with pytest.raises(UsageError, match='its own parent'):
        static_transform_publisher.command((0, 0, 0), (0, 0, 0, 1), 'map', '/map')
    with pytest.raises(UsageError, match='is not a rotation'):
        static_transform_publisher.command((0, 0, 0), (0, 0, 0, 0), 'map', 'base')
    with pytest.raises(UsageError, match='did you mean 0 0 0 1'):
        static_transform_publisher.command((0, 0, 0), (0, 0, 0, 2 * pi), 'map', 'base')
