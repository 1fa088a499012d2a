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
    for name in re.findall(r'^(?:import|from) (tf\w+)', block.code, re.MULTILINE):
        pytest.importorskip(name)
    begin = 'recorded at most 0.001 s' if 'recorded at most' in block.code else ''
    if 'end_effector' in block.code or 'joint_command' in block.code:
        start(*ARM).line_with('t = 0')
    if 'end_effector' in block.code:
        begin = 'geometry_msgs.msg.Vector3('
    if 'dummy_arm.grading' in block.code:
        begin = 'lab/dummy_arm.py: ok'
    if 'RobotStatePublisher' in block.code:
        begin = '[INFO]'
    process = start('-c', block.code, cwd=bag_of_a_walk)
    if 'rclpy.spin(' in block.code:
        ros = request.getfixturevalue('ros')
        ros.until(lambda: ros.node.count_publishers('/tf'))
        if begin:
            process.line_with(begin)
        process.press_ctrl_c()
    assert process.exit_code() == 0, process.output
    assert process.output.startswith(begin)
    assert process.output.count('\n') == bool(begin)


@pytest.mark.parametrize(('page', 'section'), [each for each in SECTIONS if each not in LONG])
def test_commands_run(start, bag_of_a_walk, page, section):  # noqa: F811
    """Each command ends with exit code 0, by itself or after Ctrl-C."""
    run_section(start, bag_of_a_walk, page, section)
