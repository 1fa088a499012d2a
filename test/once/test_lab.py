"""The model answers of the lab run; test_lab.py of test/unit looks at their text."""

from math import cos, sin
import os
import shutil

import numpy as np
from pages import LAB
import pytest

from puretf import TFMessage


@pytest.mark.parametrize('answer', [path.stem for path in LAB.glob('*.py')])
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
    messages: list[TFMessage] = []
    ros.node.create_subscription(TFMessage, '/tf', messages.append, 100)
    ros.until(lambda: len(messages) > 5)
    assert [each.child_frame_id for each in messages[0].transforms] == (
        ['joint_1', 'joint_2', 'joint_3', 'end_effector'] if name == 'dummy_arm' else
        ['moving_frame'])
    for message in messages * (name != 'dummy_arm'):
        transform = message.transforms[0].transform
        at, turn = transform.translation, transform.rotation
        half = 0.0 if answer == name else np.arctan2(at.y, at.x) / 2
        assert (turn.x, turn.y) == (0.0, 0.0)
        assert abs(turn.z * sin(half) + turn.w * cos(half)) == pytest.approx(1.0)
    process.press_ctrl_c()
    assert (process.exit_code(), 'Traceback' in process.output) == (0, False)


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
