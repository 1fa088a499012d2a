"""The launch file of ROS 2, the configuration of rviz2, and the description of the arm."""

import json
from math import cos, sin, tan
from pathlib import Path
import runpy
import shutil
import subprocess
import sys
from types import ModuleType

from environment import ROOT
import numpy as np
import pytest
import yaml

LAUNCH, RVIZ = 'launch/dummy_arm.launch.py', 'rviz/dummy_arm.rviz'
URDF = 'dummy_arm/urdf/dummy_arm.urdf'
#: The classes of rviz_default_plugins and rviz_common of Jazzy that the configuration uses.
CLASSES = {
    f'rviz_default_plugins/{name}' for name in (
        'FocusCamera', 'Grid', 'Interact', 'Measure', 'MoveCamera', 'Orbit', 'RobotModel',
        'Select', 'TF')
} | {'rviz_common/Displays', 'rviz_common/Views'}


def test_they_are_installed():
    """They are in the share directory of the package, where ros2 and rviz2 look for them."""
    code = ('import json, setuptools\nfrom distutils.core import run_setup\n'
            'print(json.dumps(run_setup("setup.py", stop_after="init").data_files))')
    output = subprocess.run([sys.executable, '-c', code], cwd=ROOT, check=True, text=True,
                            stdout=subprocess.PIPE).stdout
    data_files = dict(json.loads(output))
    for file in LAUNCH, RVIZ, URDF:
        assert data_files[f'share/dummy_arm/{Path(file).parent.name}'] == [file]
        assert (ROOT / file).is_file()


def classes_in(config):
    """Return the classes that a configuration of rviz uses."""
    if isinstance(config, list):
        return [name for each in config for name in classes_in(each)]
    if isinstance(config, dict):
        own = [config['Class']] if config.get('Class') else []
        return own + [name for each in config.values() for name in classes_in(each)]
    return []


def test_rviz_has_the_classes_of_jazzy():
    """It uses no other classes, and shows the arm, and the frames with their names, in map."""
    config = yaml.safe_load((ROOT / RVIZ).read_text())
    assert set(classes_in(config)) == CLASSES
    manager = config['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'map'
    displays = {display['Class']: display for display in manager['Displays']}
    tf, model = (displays[f'rviz_default_plugins/{name}'] for name in ('TF', 'RobotModel'))
    assert all(tf[shown] is True for shown in ('Enabled', 'Show Axes', 'Show Names'))
    assert model['Enabled'] is model['Visual Enabled'] is True
    topic = model['Description Topic']
    assert (model['Description Source'], topic['Value'], topic['Durability Policy']) == (
        'Topic', '/robot_description', 'Transient Local')


def test_the_camera_of_rviz_sees_the_whole_arm():
    """In a 4:3 window, the arm is visible in every position, and not too small."""
    view = yaml.safe_load((ROOT / RVIZ).read_text())['Visualization Manager']['Views']['Current']
    yaw, pitch = view['Yaw'], view['Pitch']
    focal = np.array([view['Focal Point'][axis] for axis in 'XYZ'])
    backwards = np.array([cos(yaw) * cos(pitch), sin(yaw) * cos(pitch), sin(pitch)])
    right = np.array([-sin(yaw), cos(yaw), 0.0])
    up = np.cross(backwards, right)
    limits = np.radians([45, 30, 60])
    turned = np.random.default_rng(1).uniform(-limits, limits, (300, 3)).cumsum(axis=1)
    along = np.stack([np.cos(turned), np.sin(turned), 0 * turned], axis=2)
    ends = [0.0, 0.0, 0.3] + np.cumsum(along * [[0.4], [0.3], [0.2]], axis=1)
    points = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.3], *ends.reshape(-1, 3)]
    seen = np.array(points) - focal - view['Distance'] * backwards
    depths = -seen @ backwards
    half = tan(0.5 * 0.7854)  # rviz's field of view is 45 degrees
    assert (depths > 1.0).all()
    heights, widths = abs(seen @ up) / depths / half, abs(seen @ right) / depths / half / (4 / 3)
    assert 0.5 < max(heights.max(), widths.max()) < 0.95


def test_each_frame_has_one_publisher(monkeypatch):
    """The arm leaves its transforms and the description to robot_state_publisher."""
    def stand_in(name, **contents):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
        vars(sys.modules[name]).update(contents)

    stand_in('ament_index_python.packages', get_package_share_path=lambda name: ROOT / name)
    stand_in('launch', LaunchDescription=list)
    stand_in('launch.actions', DeclareLaunchArgument=lambda name, **_: {})
    stand_in('launch.conditions', IfCondition=str)
    stand_in('launch.substitutions', LaunchConfiguration='value of {}'.format)
    stand_in('launch_ros.actions', Node=lambda **kwargs: kwargs)
    stand_in('launch_ros.parameter_descriptions',
             ParameterValue=lambda value, value_type: value_type(value))
    actions = runpy.run_path(str(ROOT / LAUNCH))['generate_launch_description']()
    parameters = {action['executable']: {
        name: value for group in action['parameters'] for name, value in group.items()}
        for action in actions if action}
    common = {'use_sim_time': 'value of use_sim_time', 'frame_prefix': 'value of frame_prefix'}
    assert parameters['dummy_arm'] == {**common, 'rate': 'value of rate', 'publish_tf': False,
                                       'publish_description': False}
    assert parameters['robot_state_publisher'] == {
        **common, 'ignore_timestamp': True, 'robot_description': (ROOT / URDF).read_text()}


@pytest.mark.skipif(shutil.which('ros2') is None, reason='the command ros2 is not installed')
def test_launched(start):
    """Both nodes run with the arguments of the launch file until Ctrl-C, and not longer."""
    process = start('-c', 'import os, sys; os.execvp("ros2", ["ros2", *sys.argv[1:]])', 'launch',
                    str(ROOT / LAUNCH), 'rviz:=false', 'rate:=20', 'frame_prefix:=a/')
    line = process.line_with('publishing map -> a/base_link')
    assert 'at 20 Hz' in line
    process.press_ctrl_c()
    assert process.exit_code() == 0
    assert not process.has_left_processes()
