"""The command `static_transform_publisher`: publish one transform on /tf_static."""

import argparse
from collections.abc import Sequence
from math import hypot
from secrets import token_hex
from typing import Optional

import rclpy
from rclpy.node import Node

from puretf import StaticTransformBroadcaster, Transform
from puretf.rotations import quaternion_from_euler
from puretf_tools.cli.node import run_node
from puretf_tools.cli.parser import add_namespace_option, number, Parser, run, UsageError

TRANSLATION = ('x', 'y', 'z')
QUATERNION = ('qx', 'qy', 'qz', 'qw')
EULER = ('roll', 'pitch', 'yaw')
#: The old-style arguments that come before the two frames. The angles are in the same order as in
#: tf2.
OLD_EULER = (*TRANSLATION, 'yaw', 'pitch', 'roll')
OLD_QUATERNION = (*TRANSLATION, *QUATERNION)
#: The squared length of a quaternion must differ from 1 by less than this value, as in tf2.
_TOLERANCE = 0.01


def _listed(values: Sequence[float]) -> str:
    return ', '.join(f"'{value:f}'" for value in values)


def command(translation: Sequence[float], rotation: Sequence[float], frame_id: str,
            child_frame_id: str, namespace: str = '', *, is_old_style: bool = False,
            ros_args: Sequence[str] = ()) -> int:
    """Publish the pose of a child frame in its parent frame, until Ctrl-C or SIGTERM."""
    for name, what in (frame_id, 'Frame id'), (child_frame_id, 'Child frame id'):
        if not name.removeprefix('/'):
            raise UsageError(f'{what} must not be empty')
    if frame_id.removeprefix('/') == child_frame_id.removeprefix('/'):
        raise UsageError(f"cannot publish static transform from '{frame_id}' to "
                         f"'{child_frame_id}': a frame cannot be its own parent")
    length = hypot(*rotation)
    if length == 0.0:
        raise UsageError('the quaternion 0 0 0 0 is not a rotation; the identity is 0 0 0 1')
    unit = [value / length for value in rotation]
    if abs(length * length - 1.0) >= _TOLERANCE:
        raise UsageError(
            f'the length of the quaternion {" ".join(f"{value:g}" for value in rotation)} must be '
            f'1, not {length:g}; did you mean {" ".join(f"{value:.6g}" for value in unit)}?')
    (x, y, z), (qx, qy, qz, qw) = translation, unit

    def make_node() -> Node:
        # As in tf2, the end of the name is random, so that several of these nodes can run at once.
        node = rclpy.create_node(f'static_transform_publisher_{token_hex(8)}')
        if is_old_style:
            node.get_logger().warning(
                'Old-style arguments are deprecated; see --help for new-style arguments')
        StaticTransformBroadcaster(node).sendTransform(Transform(
            node.get_clock().now().nanoseconds, frame_id, child_frame_id, (x, y, z),
            (qx, qy, qz, qw)).to_message())
        node.get_logger().info(
            'Spinning until stopped - publishing transform\n'
            f'translation: ({_listed(translation)})\nrotation: ({_listed(unit)})\n'
            f"from '{frame_id}' to '{child_frame_id}'")
        return node

    return run_node(make_node, ros_args, namespace)


def run_with_options(old_style: list[str], ros_args: Sequence[str], frame_id: Optional[str],
                     child_frame_id: Optional[str], namespace: str, **flags: Optional[float]
                     ) -> int:
    """Call `command` with the values of the flags or of the old-style arguments."""
    given = {name: value for name, value in flags.items() if value is not None}
    if old_style:
        if given or frame_id is not None or child_frame_id is not None:
            raise UsageError('Cannot specify both new-style (flags) and old-style (arguments)')
        names = {8: OLD_EULER, 9: OLD_QUATERNION}.get(len(old_style))
        if names is None:
            raise UsageError(
                f'the old style needs 8 arguments ({" ".join(OLD_EULER)} frame_id child_frame_id) '
                f'or 9 ({" ".join(OLD_QUATERNION)} frame_id child_frame_id), got '
                f'{len(old_style)}')
        *numbers, frame_id, child_frame_id = old_style
        for name, text in zip(names, numbers):
            try:
                given[name] = number(text)
            except argparse.ArgumentTypeError as error:
                raise UsageError(f'argument {name}: {error}') from None
    if frame_id is None or child_frame_id is None:
        raise UsageError('both --frame-id and --child-frame-id must be given; see --help')
    angles, quaternion = ([name for name in names if name in given]
                          for names in (EULER, QUATERNION))
    if angles and quaternion:
        raise UsageError(f'Cannot specify both quaternion and Euler rotations: --{quaternion[0]} '
                         f'and --{angles[0]}')
    values = {**dict.fromkeys(flags, 0.0), 'qw': 1.0, **given}
    rotation = [values[name] for name in QUATERNION]
    if angles:
        rotation = [*quaternion_from_euler(values['roll'], values['pitch'], values['yaw'])]
    return command([values[name] for name in TRANSLATION], rotation, frame_id, child_frame_id,
                   namespace, is_old_style=bool(old_style), ros_args=ros_args)


def main(args: Optional[Sequence[str]] = None) -> int:
    parser = Parser(
        'static_transform_publisher', 'Publish a static transform on /tf_static until '
        'Ctrl-C. Angles are in radians.',
        'example: static_transform_publisher --z 0.5 --yaw -1.57 --frame-id map --child-frame-id '
        'camera\n\nold style, deprecated: x y z yaw pitch roll frame_id child_frame_id, or\n'
        'x y z qx qy qz qw frame_id child_frame_id',
        usage='static_transform_publisher [options] --frame-id FRAME --child-frame-id FRAME')
    for names, what in ((TRANSLATION, 'translation along {} (m)'),
                        (QUATERNION, '{} of the quaternion'), (EULER, 'angle about {} (rad)')):
        for name, axis in zip(names, 'xyzw'):
            parser.add_argument(f'--{name}', type=number, help=what.format(axis))
    parser.add_argument('--frame-id', help='the parent frame')
    parser.add_argument('--child-frame-id', help='the child frame, whose pose is published')
    add_namespace_option(parser, 'publish on', 'tf_static')
    parser.add_argument('old_style', nargs='*', help=argparse.SUPPRESS)
    return run(parser, run_with_options, args)
