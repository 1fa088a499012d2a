"""The lab of the course, step by step, with its own commands over DDS; and the model answers."""

from difflib import unified_diff
from itertools import pairwise
from math import cos, pi, sin
import os
from pathlib import Path
import re
import shutil
import signal

from conftest import ARM, tool
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy

from dummy_arm.arm import Arm
from dummy_arm.tf import TFMessage
from dummy_arm.tf._ros.qos import profile
from dummy_arm.tools.check_arm import main as check_arm

LATCHED = profile(None, 10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def receive(ros, number):
    """
    Receive messages of /tf that have one transform each.

    :returns: the stamps (s), the translations (m), and the rotations (quaternions x, y, z, w).
    """
    messages: list[TFMessage] = []
    subscription = ros.node.create_subscription(TFMessage, '/tf', messages.append, 100)
    ros.until(lambda: len(messages) >= number)
    ros.node.destroy_subscription(subscription)
    transforms = [message.transforms[0] for message in messages]
    assert {(t.header.frame_id, t.child_frame_id) for t in transforms} == {('map', 'moving_frame')}
    return (np.array([t.header.stamp.sec + t.header.stamp.nanosec / 1e9 for t in transforms]),
            np.array([[t.transform.translation.x, t.transform.translation.y,
                       t.transform.translation.z] for t in transforms]),
            np.array([[t.transform.rotation.x, t.transform.rotation.y, t.transform.rotation.z,
                       t.transform.rotation.w] for t in transforms]))


def test_step_1_static_transform(ros, start):
    """Frames with slashes and the old style work; a later subscriber gets the transform, too."""
    process = start(*tool(
        'static_transform_publisher', '1', '0', '0', '0', '0', '0', '/map', '/base_link'))
    process.line_with("from '/map' to '/base_link'")
    messages: list[TFMessage] = []
    ros.node.create_subscription(TFMessage, '/tf_static', messages.append, LATCHED)
    ros.until(lambda: messages)
    (transform,) = messages[0].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ('/map', '/base_link')
    assert transform.transform.translation.x == 1.0
    assert transform.transform.rotation.w == 1.0
    echo = start(*tool('tf2_echo', 'map', 'base_link', '--once'))
    assert echo.exit_code() == 0
    assert '- Translation: [1.000, 0.000, 0.000]\n' in echo.output
    process.end(signal.SIGINT)
    assert process.exit_code() == 0
    assert 'Traceback' not in process.output


def test_steps_2_to_4_dynamic_transform(ros, start):
    """The frame moves on a circle; each kind of rotation can be set while it runs."""
    process = start(*tool('dynamic_tf_publisher'))
    stamps, points, rotations = receive(ros, 15)
    assert np.median(np.diff(stamps)) == pytest.approx(0.1, rel=0.3)
    angles = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
    np.testing.assert_allclose(np.diff(angles), 0.1, atol=1e-9)
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 1.0, atol=1e-9)
    assert (points[:, 2] == 0.0).all()
    assert (rotations == [0.0, 0.0, 0.0, 1.0]).all()

    def set_to(name, value):
        setting = start(*tool('param', 'dynamic_tf_publisher', name, value))
        assert setting.exit_code() == 0, setting.output

    set_to('rotation', 'quaternion')
    _, points, by_hand = receive(ros, 5)
    for (x, y, _), (*axis, w) in zip(points, by_hand):
        assert axis[:2] == [0.0, 0.0]
        assert (1 - 2 * axis[2] ** 2, 2 * axis[2] * w) == pytest.approx((x, y), abs=1e-9)

    set_to('rotation', 'euler')
    _, points, by_euler = receive(ros, 5)
    for (x, y, _), (*axis, w) in zip(points, by_euler):
        assert (1 - 2 * axis[2] ** 2, 2 * axis[2] * w) == pytest.approx((x, y), abs=1e-9)
    set_to('roll', str(pi / 2))
    _, points, by_euler = receive(ros, 5)
    for (x, y, _), quaternion in zip(points, by_euler):
        half = np.arctan2(y, x) / 2
        expected = np.array([cos(half), sin(half), sin(half), cos(half)]) * np.sqrt(0.5)
        np.testing.assert_allclose(
            quaternion * np.sign(quaternion @ expected), expected, atol=1e-9)
    process.end(signal.SIGTERM)
    assert process.exit_code() == 0


def test_steps_5_and_6_the_frames_of_the_arm(start, tmp_path):
    """view_frames draws the running arm to frames.pdf in the current directory."""
    start(*ARM).line_with('t = 0')
    process = start(*tool('view_frames'), cwd=tmp_path)
    assert process.exit_code() == 0, process.output
    assert process.output == (
        'wrote frames.pdf and frames.gv: frames: 6, transforms: 5, root: map\n')
    assert {path.name for path in tmp_path.iterdir()} == {'frames.pdf', 'frames.gv'}
    pypdf = pytest.importorskip('pypdf')
    (page,) = pypdf.PdfReader(tmp_path / 'frames.pdf').pages
    heights: dict[str, float] = {}
    text = page.extract_text(visitor_text=lambda text, _, matrix, *rest: heights.setdefault(
        text.strip(), matrix[5]))
    lines = [line.strip() for line in text.splitlines()]
    frames = ['map', *Arm().frames]
    assert sorted(line for line in lines if line in frames) == sorted(frames)
    down = [heights[frame] for frame in frames]  # the root is at the top of the page
    assert down == sorted(set(down))
    assert lines.count('Broadcaster: /dummy_arm') == 5
    assert lines.count('static') == 1
    rates = [float(line.split()[2]) for line in lines if line.startswith('Average rate: ')]
    assert len(rates) == 4
    assert 25.0 < min(rates) <= max(rates) < 55.0  # the rate is 50 Hz, less on a busy machine
    lengths = [float(line.split()[2]) for line in lines if line.startswith('Buffer length: ')]
    assert len(lengths) == 4
    assert 0.5 < min(lengths) <= max(lengths) < 5.5  # the discovery of the arm may take seconds
    dot = (tmp_path / 'frames.gv').read_text()
    for parent, child in pairwise(frames):
        assert f'"{parent}" -> "{child}" [' in dot
    assert dot.count('->') == 5
    for name in 'frames.pdf', 'frames.gv':
        assert check_arm(['--frames', str(tmp_path / name)]) == 0


# The model answers

LAB = Path(__file__).parent.parent / 'lab'
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


@pytest.mark.parametrize('answer', [
    ANSWERS[0], ANSWERS[3],
    *(pytest.param(name, marks=pytest.mark.soak) for name in ANSWERS[1:3])])
def test_a_model_answer_in_a_package(start, tmp_path, ros, answer):
    """In a package as `ros2 pkg create` writes it, the answer is built by colcon and runs."""
    if 'euler' in answer:
        pytest.importorskip('tf_transformations')
    name = 'dummy_arm' if answer == 'dummy_arm' else 'dynamic_tf_publisher'
    package = tmp_path / 'src' / name
    for path, text in package_files(name).items():
        (package / path).parent.mkdir(parents=True, exist_ok=True)
        (package / path).write_text(text)
    shutil.copyfile(LAB / f'{answer}.py', package / name / f'{name}.py')
    build = start('-m', 'colcon', 'build', cwd=tmp_path)
    assert build.exit_code(120.0) == 0, build.output
    assert '1 package finished' in build.output
    prefix = tmp_path / 'install' / name
    (libraries,) = prefix.glob('lib/python*/site-packages')
    process = start(str(prefix / 'lib' / name / name), environment={
        'PYTHONPATH': os.pathsep.join(filter(None, (
            str(libraries), os.environ.get('PYTHONPATH'))))})
    process.line_with('publishing the arm' if name == 'dummy_arm' else 'map -> moving_frame')
    if name == 'dummy_arm':
        messages: list[TFMessage] = []
        ros.node.create_subscription(TFMessage, '/tf', messages.append, 100)
        ros.until(lambda: messages)
        assert [transform.child_frame_id for transform in messages[0].transforms] == [
            'joint_1', 'joint_2', 'joint_3', 'end_effector']
    else:
        _, points, rotations = receive(ros, 5)
        for (x, y, _), rotation in zip(points, rotations):
            half = 0.0 if answer == ANSWERS[0] else np.arctan2(y, x) / 2
            assert abs(rotation @ [0.0, 0.0, sin(half), cos(half)]) == pytest.approx(1.0)
    process.press_ctrl_c()
    assert process.exit_code() == 0
    assert 'Traceback' not in process.output


def package_files(name):
    """Return the files of `ros2 pkg create --build-type ament_python --node-name name name`."""
    return {
        'package.xml': f"""<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>0.0.0</version>
  <description>TODO: Package description</description>
  <maintainer email="student@todo.todo">student</maintainer>
  <license>TODO: License declaration</license>
  <test_depend>ament_copyright</test_depend>
  <test_depend>python3-pytest</test_depend>
  <export>
    <build_type>ament_python</build_type>
  </export>
</package>
""",
        'setup.py': f"""from setuptools import find_packages, setup

package_name = '{name}'

setup(
    name=package_name,
    version='0.0.0',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages',
            ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools'],
    zip_safe=True,
    maintainer='student',
    maintainer_email='student@todo.todo',
    description='TODO: Package description',
    license='TODO: License declaration',
    entry_points={{
        'console_scripts': [
            '{name} = {name}.{name}:main'
        ],
    }},
)
""",
        'setup.cfg': f'[develop]\nscript_dir=$base/lib/{name}\n'
                     f'[install]\ninstall_scripts=$base/lib/{name}\n',
        f'resource/{name}': '', f'{name}/__init__.py': ''}
