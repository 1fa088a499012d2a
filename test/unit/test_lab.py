"""The model answers of the lab: what they look like. test/once runs them."""

from difflib import unified_diff
import re

from environment import ROOT
import pytest

LAB = ROOT / 'lab'
ANSWERS = ('dynamic_tf_publisher', 'dynamic_tf_publisher_quaternion',
           'dynamic_tf_publisher_euler', 'dummy_arm')


def test_the_model_answers_are_short_and_import_only_what_a_student_has():
    """They have at most 80 lines, and import rclpy, geometry_msgs, tf2_ros and math."""
    assert {path.name for path in LAB.iterdir() if path.suffix} == {
        f'{name}.py' for name in ANSWERS}
    for name in ANSWERS:
        code = (LAB / f'{name}.py').read_text()
        assert code.count('\n') <= 80
        modules = {module.split('.')[0] for module in re.findall(
            r'^\s*(?:import|from) (\S+)', code, re.M)}
        assert modules <= {'rclpy', 'geometry_msgs', 'tf2_ros', 'tf_transformations', 'math'}


@pytest.mark.parametrize(('task', 'next_task', 'changed'), [
    (ANSWERS[0], ANSWERS[1], r'rotation\.[zw] = '),
    (ANSWERS[1], ANSWERS[2],
     r'import quaternion_from_euler|rotation\.[xyzw] = |roll, pitch, yaw')])
def test_consecutive_tasks_differ_only_in_what_the_lab_changes(task, next_task, changed):
    """Only the rotation changes, and the first line, which says which task it is."""
    old, new = ((LAB / f'{name}.py').read_text().splitlines() for name in (task, next_task))
    differences = [line for line in unified_diff(old, new, n=0)
        if line[0] in '+-' and line[:3] not in ('+++', '---') and '"""Task' not in line]
    assert differences
    assert [line for line in differences if not re.search(changed, line)] == []
