"""The command `static_transform_publisher`: both styles of arguments, and their errors."""

from math import cos, sin
import re
from typing import Any

from processes import tool
import pytest
from ros_node import command_node, LATCHED, pose_of

from puretf import TFMessage
from puretf_tools.commands import static_transform_publisher

NAME = 'static_transform_publisher'
FRAMES = ['--frame-id', 'map', '--child-frame-id', 'base']


@pytest.fixture
def publish(domain_id, monkeypatch):
    """Run the command until its transform arrives; return it and the name of the node."""
    def run(*arguments):
        results: list[Any] = []

        def run_node(make_node, ros_args, namespace):
            with command_node(make_node, domain_id, *ros_args[1:]) as (node, ros):
                messages: list[TFMessage] = []
                ros.node.create_subscription(TFMessage, '/tf_static', messages.append, LATCHED)
                ros.until(lambda: messages)
                results.extend((*messages[0].transforms, node.get_name()))
            return 0

        monkeypatch.setattr(static_transform_publisher, 'run_node', run_node)
        assert static_transform_publisher.main(arguments) == 0
        transform, name = results
        return transform, name

    return run


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
def test_new_style(publish, capfd, arguments, expected):
    """Options accept negative numbers and exponents, and a quaternion of nearly unit length."""
    transform, _ = publish(*arguments)
    assert pose_of(transform) == pytest.approx(expected, abs=1e-12)
    assert (transform.header.frame_id, transform.child_frame_id) == ('map', 'base')
    assert 'deprecated' not in capfd.readouterr().err


@pytest.mark.parametrize(('arguments', 'expected'), [
    # The angles are yaw, pitch and roll, in this order: quarter turns about z, y and x.
    ('1 2 3 1.5707963267948966 0 0 /map base', [1, 2, 3, 0, 0, 0.5**0.5, 0.5**0.5]),
    ('-1 -2e0 -.5 0 1.5707963267948966 0 map /base', [-1, -2, -0.5, 0, 0.5**0.5, 0, 0.5**0.5]),
    ('0 0 0 0 0 -1.5707963267948966 /map /base', [0, 0, 0, -0.5**0.5, 0, 0, 0.5**0.5]),
    ('0 0 0 0 0 0.6 0.8 map base', [0, 0, 0, 0, 0, 0.6, 0.8]),
    ('0 0 0 0 0 0 -1 map base', [0, 0, 0, 0, 0, 0, -1]),
])
def test_old_style(publish, capfd, arguments, expected):
    """The old style is deprecated; leading slashes are published."""
    transform, _ = publish(*arguments.split())
    assert pose_of(transform) == pytest.approx(expected, abs=1e-12)
    assert [transform.header.frame_id, transform.child_frame_id] == arguments.split()[-2:]
    assert 'Old-style arguments are deprecated; see --help for new-style arguments\n' in (
        capfd.readouterr().err)


def test_its_name_is_unique(publish):
    """Several of these nodes can run at once, as with tf2."""
    names = {publish(*FRAMES)[1] for _ in range(2)}
    assert len(names) == 2
    for name in names:
        assert re.fullmatch(f'{NAME}_[A-Za-z0-9]{{16}}', name)


def test_it_prints_the_transform_until_a_signal(start):
    """It prints tf2's lines."""
    process = start(*tool(NAME, '--x', '1', *FRAMES))
    process.line_with('Spinning until stopped - publishing transform')
    process.line_with("from 'map' to 'base'\n")
    process.end_normally()
    assert process.output.splitlines()[1:] == [
        "translation: ('1.000000', '0.000000', '0.000000')",
        "rotation: ('0.000000', '0.000000', '0.000000', '1.000000')", "from 'map' to 'base'"]


@pytest.mark.parametrize(('arguments', 'message'), [
    # tf2 aborts with a core dump:
    (['--frame-id', 'map', '--child-frame-id', 'map'], "from 'map' to 'map': a frame cannot be"),
    (['--frame-id', '/map', '--child-frame-id', 'map'], "from '/map' to 'map': a frame cannot be"),
    (['0', '0', '0', '0', '0', '0', 'map', 'map'], "from 'map' to 'map': a frame cannot be"),
    # tf2 publishes them without a warning:
    (['--qw', '0', *FRAMES], '0 0 0 0 is not a rotation; the identity is 0 0 0 1'),
    (['--qz', '1', *FRAMES], 'of the quaternion 0 0 1 1 must be 1, not 1.41421; '
                             'did you mean 0 0 0.707107 0.707107[?]'),
    (['--qw', 'nan', *FRAMES], "argument --qw: 'nan' is not finite"),
    (['0', '0', 'nan', '0', '0', '0', 'map', 'base'], "argument z: 'nan' is not finite"),
    # tf2 reads 1.0:
    (['--x', '1.0abc', *FRAMES], "argument --x: '1.0abc' is not a number"),
    (['0', '0', '0', '1,5', '0', '0', 'map', 'base'], "argument yaw: '1,5' is not a number"),
    (['--x', *FRAMES], 'argument --x: expected one argument'),
    # tf2 ignores the second one:
    (['--qw', '1', '--yaw', '0', *FRAMES], 'both quaternion and Euler rotations: --qw and --yaw'),
    (['--yaw', '1', '0', '0', '0', '0', '0', '0', 'map', 'base'], 'both new-style'),
    (['0', '0', '0', '0', '0', '0', 'map', 'base', '--x', '1'], 'both new-style .* and old-style'),
    (['--child-frame-id', 'map'], 'both --frame-id and --child-frame-id must be given'),
    (['--frame-id', '', '--child-frame-id', 'base'], 'Frame id must not be empty'),
    (['--frame-id', 'map', '--child-frame-id', '/'], 'Child frame id must not be empty'),
    (['--frame-id', 'a\udcff', '--child-frame-id', 'b'], 'must be valid Unicode'),
    (['1', '2', '3'], r'8 arguments \(x y z yaw pitch roll .*\) or 9 \(.*\), got 3'),
    ([*'0123456789', 'map', 'base'], r'8 arguments \(.*\) or 9 \(.*\), got 12'),
    (['--frame_id', 'map', '--child-frame-id', 'base'], r'--frame_id.*did you mean --frame-id\?'),
])
def test_wrong_use_is_one_line_and_exit_code_2(failed, arguments, message):
    """The line names the error, and often the remedy."""
    code, line = failed(static_transform_publisher.main, *arguments)
    assert code == 2
    assert re.fullmatch(f'{NAME}: .*{message}.*\n', line)
