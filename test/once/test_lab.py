"""The lab of the course, step by step, with its own commands over DDS; and the model answers."""

from math import cos, pi, sin
import os
import shutil
import signal

from environment import ROOT
import numpy as np
from processes import ARM, tool
import pytest
from ros_node import LATCHED

from dummy_arm.check_arm import main as check_arm
from puretf import TFMessage


def receive(ros, number):
    """
    Receive messages of /tf that have one transform each.

    :returns: the translations (m), and the rotations (quaternions x, y, z, w).
    """
    messages: list[TFMessage] = []
    subscription = ros.node.create_subscription(TFMessage, '/tf', messages.append, 100)
    ros.until(lambda: len(messages) >= number)
    ros.node.destroy_subscription(subscription)
    transforms = [message.transforms[0] for message in messages]
    assert {(t.header.frame_id, t.child_frame_id) for t in transforms} == {('map', 'moving_frame')}
    return (np.array([[t.transform.translation.x, t.transform.translation.y,
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
    process.end_normally()


def test_steps_2_to_4_dynamic_transform(ros, start):
    """The frame moves on a circle; each kind of rotation can be set while it runs."""
    process = start(*tool('dynamic_tf_publisher'))
    points, rotations = receive(ros, 15)
    angles = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
    np.testing.assert_allclose(np.diff(angles), 0.1, atol=1e-9)
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 1.0, atol=1e-9)
    assert (points[:, 2] == 0.0).all()
    assert (rotations == [0.0, 0.0, 0.0, 1.0]).all()

    def set_to(name, value):
        setting = start(*tool('param', 'dynamic_tf_publisher', name, value))
        assert setting.exit_code() == 0, setting.output

    set_to('rotation', 'quaternion')
    points, by_hand = receive(ros, 5)
    for (x, y, _), (*axis, w) in zip(points, by_hand):
        assert axis[:2] == [0.0, 0.0]
        assert (1 - 2 * axis[2] ** 2, 2 * axis[2] * w) == pytest.approx((x, y), abs=1e-9)

    set_to('rotation', 'euler')
    points, by_euler = receive(ros, 5)
    for (x, y, _), (*axis, w) in zip(points, by_euler):
        assert (1 - 2 * axis[2] ** 2, 2 * axis[2] * w) == pytest.approx((x, y), abs=1e-9)
    set_to('roll', str(pi / 2))
    points, by_euler = receive(ros, 5)
    for (x, y, _), quaternion in zip(points, by_euler):
        half = np.arctan2(y, x) / 2
        expected = np.array([cos(half), sin(half), sin(half), cos(half)]) * np.sqrt(0.5)
        np.testing.assert_allclose(
            quaternion * np.sign(quaternion @ expected), expected, atol=1e-9)
    process.end_normally(signal.SIGTERM)


def test_steps_5_and_6_the_frames_of_the_arm(start, tmp_path):
    """view_frames draws the running arm to frames.pdf in the current directory."""
    start(*ARM).line_with('t = 0')
    process = start(*tool('view_frames'), cwd=tmp_path)
    assert process.exit_code() == 0, process.output
    assert process.output == (
        'wrote frames.pdf and frames.gv: frames: 6, transforms: 5, root: map\n')
    assert {path.name for path in tmp_path.iterdir()} == {'frames.pdf', 'frames.gv'}
    pypdf = pytest.importorskip('pypdf')
    lines = [line.strip() for line in pypdf.PdfReader(
        tmp_path / 'frames.pdf').pages[0].extract_text().splitlines()]
    assert (lines.count('Broadcaster: /dummy_arm'), lines.count('static')) == (5, 1)
    for label in 'Average rate: ', 'Buffer length: ':
        numbers = [float(line.split()[2]) for line in lines if line.startswith(label)]
        assert len(numbers) == 4
        assert min(numbers) > 0.0
    assert check_arm(['--frames', str(tmp_path / 'frames.pdf')]) == 0


# The model answers

LAB = ROOT / 'lab'
ANSWERS = ('dynamic_tf_publisher', 'dynamic_tf_publisher_quaternion',
           'dynamic_tf_publisher_euler', 'dummy_arm')


@pytest.mark.parametrize('answer', ANSWERS)
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
        points, rotations = receive(ros, 5)
        for (x, y, _), rotation in zip(points, rotations):
            half = 0.0 if answer == ANSWERS[0] else np.arctan2(y, x) / 2
            assert abs(rotation @ [0.0, 0.0, sin(half), cos(half)]) == pytest.approx(1.0)
    process.press_ctrl_c()
    if process.exit_code():  # Ctrl-C came while the timer's callback was publishing
        assert "RCLError: Failed to publish: publisher's context is invalid" in process.output
    else:
        assert 'Traceback' not in process.output


def package_files(name):
    """Return what matters of `ros2 pkg create --build-type ament_python --node-name name name`."""
    return {
        'package.xml': f"""<package format="3">
  <name>{name}</name><version>0.0.0</version><description>TODO</description>
  <maintainer email="student@todo.todo">student</maintainer><license>TODO</license>
  <export><build_type>ament_python</build_type></export>
</package>
""",
        'setup.py': f"""from setuptools import find_packages, setup

setup(
    name='{name}', version='0.0.0', packages=find_packages(exclude=['test']),
    data_files=[('share/ament_index/resource_index/packages', ['resource/{name}']),
                ('share/{name}', ['package.xml'])],
    entry_points={{'console_scripts': ['{name} = {name}.{name}:main']}})
""",
        'setup.cfg': f'[develop]\nscript_dir=$base/lib/{name}\n'
                     f'[install]\ninstall_scripts=$base/lib/{name}\n',
        f'resource/{name}': '', f'{name}/__init__.py': ''}
