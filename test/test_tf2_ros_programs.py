"""Tests with programs that were written for tf2_ros, in the style of examples_tf2_py."""

from pathlib import Path
import re

from geometry_msgs.msg import TransformStamped
import pytest

from dummy_arm.tf import StaticTransformBroadcaster, TransformBroadcaster

PROGRAMS = Path(__file__).parent / 'tf2_ros_programs'


@pytest.fixture
def ported(tmp_path):
    """The directory with copies of the programs, in which only the imports are changed."""
    for program in PROGRAMS.glob('*.py'):
        code = program.read_text()
        changed = re.sub(r'^from (tf2_ros|tf2_msgs\.msg)\b', 'from dummy_arm.tf', code,
                         flags=re.MULTILINE)
        assert 'tf2_' not in re.sub(r'(?s)^""".*?"""', '', changed)
        (tmp_path / program.name).write_text(changed)
    return tmp_path


@pytest.mark.parametrize(('program', 'line'), [
    ('blocking_wait', 'got transform'), ('async_wait', 'got transform from sonar'),
    ('wait_in_callback', 'got transform'), ('frame_dumper', "  parent: 'robot'")])
def test_runs_with_only_the_import_changed(ported, start, ros, program, line):
    """The program waits until the transforms arrive over DDS, and then uses them."""
    process = start(str(ported / f'{program}.py'))
    process.line_with('waiting')
    wheel, sonar = TransformStamped(child_frame_id='wheel'), TransformStamped(
        child_frame_id='sonar')
    wheel.header.frame_id = sonar.header.frame_id = 'robot'
    StaticTransformBroadcaster(ros.node).sendTransform(wheel)
    broadcaster = TransformBroadcaster(ros.node)

    def send():
        sonar.header.stamp = ros.node.get_clock().now().to_msg()
        broadcaster.sendTransform(sonar)

    ros.node.create_timer(0.02, send)
    ros.until(lambda: f'{line}\n' in process.output)
    assert 'Traceback' not in process.output
