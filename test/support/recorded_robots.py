"""
What the real robot_state_publisher 3.3.3 has answered, and where ours differs on purpose.

Its field "format" explains the file.
"""

from collections.abc import Iterable
import json
from typing import Any

from environment import DATA
import numpy as np

CASES: dict[str, dict[str, Any]] = {
    case['name']: case for case in json.loads(
        (DATA / 'robot_state_publisher.json').read_text(encoding='utf-8'))['cases']}

#: The cases of parameters and arguments that are refused; the others are about the robot.
OF_THE_COMMAND = [name for name in CASES if name.startswith((
    'error_publish_frequency_', 'error_frame_prefix_', 'error_ignore_timestamp_', 'error_file_'))]

#: The real one dies at the start, ours goes on.
ACCEPTED = {
    'error_origin_tab': 'an XML parser turns tabs in attributes into blanks',
    'error_origin_newline': 'an XML parser turns newlines in attributes into blanks',
    'error_origin_newline_after_blank': 'an XML parser turns newlines in attributes into blanks',
    'error_publish_frequency_int': 'an integer is a number of Hz, too'}
#: The real one starts, ours refuses the description.
REFUSED = {
    'error_entity_and_cdata': 'DOCTYPE is refused, because it can make short texts endless',
    'error_loop_beside_the_root': 'the real one says nothing about links that it never sends',
    'odd_origins': 'the real one sends NaN for an axis 0 0 0'}
#: The joints without which ours accepts odd_origins.
ZERO_AXES = 'm_zero_axis', 'm_slide_zero_axis', 'm_axis_without_xyz'
#: The real one sends fixed transforms of the description before, and under the prefix before.
STATIC_DIFFERS = {
    'change_description': {2: ['tip'], 8: ['tip'], 9: ['l1', 'tool']},
    'change_parameters': {10: ['y/tip']}}

Transform = tuple[str, str, list[float]]


def recorded(transforms: Iterable[dict[str, Any]]) -> list[Transform]:
    """Return frame_id, child_frame_id, and x, y, z, quaternion x, y, z, w of transforms."""
    return [(transform['frame_id'], transform['child_frame_id'],
             [float(number) for number in transform['xyz'] + transform['xyzw']])
            for transform in transforms]


def answer(case: dict[str, Any], step: int) -> list[Transform]:
    """Return the answer to a JointState that ours must give; it never sends NaN or infinity."""
    transforms, = (message['transforms'] for message in case['tf'] if message['step'] == step)
    return [transform for transform in recorded(transforms) if np.isfinite(transform[2]).all()]


def fixed(case: dict[str, Any], step: int) -> list[Transform]:
    """Return the transforms on /tf_static at a step that ours must send."""
    transforms, = (message['transforms'] for message in case['tf_static']
                   if message['step'] == step)
    children = STATIC_DIFFERS.get(case['name'], {}).get(step)
    return [transform for transform in recorded(transforms)
            if children is None or transform[1] in children]


def assert_equal(actual: Iterable[tuple[str, str, Iterable[float]]],
                 expected: list[Transform]) -> None:
    """Compare frames and order exactly, and poses to 1e-9, with the sign of the quaternion."""
    transforms = [*actual]
    assert [transform[:2] for transform in transforms] == [
        transform[:2] for transform in expected]
    for (*_, pose), (*_, numbers) in zip(transforms, expected):
        np.testing.assert_allclose([*pose], numbers, rtol=1e-9, atol=1e-9)
