"""The blocks of code in the pages run; those that take minutes do in test/long."""

import re

from pages import bag_of_a_walk, BLOCKS, LONG, run_section, SECTIONS  # noqa: F401
from processes import ARM
import pytest


@pytest.mark.parametrize('block', [
    pytest.param(block, id=f'{block.page}:{block.line}')
    for block in BLOCKS if block.language == 'python' and not block.needs])
def test_python_runs(start, bag_of_a_walk, block, request):  # noqa: F811
    """Each block is a complete program. Some of them need the arm, and one runs until Ctrl-C."""
    for name in re.findall(r'^(?:import|from) (tf\w+|sensor_msgs_py)', block.code, re.MULTILINE):
        pytest.importorskip(name)
    lines = ['recorded at most 0.001 s'] * ('recorded at most' in block.code)
    if 'in robot.topics:' in block.code:
        lines = ['/tf_static tf2_msgs/msg/TFMessage 1', '/tf tf2_msgs/msg/TFMessage 101',
                 '/scan geometry_msgs/msg/PointStamped 36', '10.001 s in 1 part(s)', *lines]
    elif "== '/scan'" in block.code:
        lines = ['36 of 36 scans of base_link can be transformed']
    elif 'is_in_gap' in block.code:  # between the two parts, from 110 to 111 s
        lines = ['9 of 210 times are in a gap']
    elif 'robot.mcap' in block.code and 'path_edges' in block.code:
        lines = ['odom -> base_link: up to 0.10 s without a transform']
    elif 'in robot.topics' in block.code:
        lines = ["['/scan']"]
    if 'end_effector' in block.code or 'joint_command' in block.code:
        start(*ARM).line_with('t = 0')
    if 'end_effector' in block.code:
        lines = ['geometry_msgs.msg.Vector3(']
    if 'dummy_arm.grading' in block.code:
        lines = ['lab/dummy_arm.py: ok']
    if 'RobotStatePublisher' in block.code:
        lines = ['[INFO]']
    process = start('-c', block.code, cwd=bag_of_a_walk)
    if 'rclpy.spin(' in block.code:
        ros = request.getfixturevalue('ros')
        ros.until(lambda: ros.node.count_publishers('/tf'))
        for line in lines:
            process.line_with(line)
        process.press_ctrl_c()
    assert process.exit_code() == 0, process.output
    # rclpy says so if Ctrl-C comes between the printing of a log line and its publication.
    printed = [line for line in process.output.splitlines() if 'message to rosout' not in line]
    assert len(printed) == len(lines), process.output
    assert all(map(str.startswith, printed, lines)), process.output


@pytest.mark.parametrize(('page', 'section'), [each for each in SECTIONS if each not in LONG])
def test_commands_run(start, bag_of_a_walk, page, section):  # noqa: F811
    """Each command ends with exit code 0, by itself or after Ctrl-C."""
    run_section(start, bag_of_a_walk, page, section)
