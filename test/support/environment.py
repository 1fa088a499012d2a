"""What is installed here, and marks for tests that need a part of it."""

from collections.abc import Iterable
from importlib.util import find_spec
import os
from pathlib import Path
import sys

import pytest

ROOT = Path(__file__).parent.parent.parent
DATA = ROOT / 'test' / 'data'
#: The prefixes of the names of modules that come with ROS.
ROS = ('rclpy', 'rosidl', 'ament', 'builtin_interfaces', 'geometry_msgs', 'nav_msgs',
       'rcl_interfaces', 'sensor_msgs', 'std_msgs', 'tf2_', 'visualization_msgs')
#: Whether the tf2_msgs of ROS or a stand-in for it is installed; that of `compat` does not count.
HAS_TF2_MSGS = find_spec('tf2_msgs') is not None and find_spec('tf2_msgs.srv') is not None
#: Variables with which programs find tf2_msgs, as on a Jazzy desktop, or else a stand-in for it.
DESKTOP = {} if HAS_TF2_MSGS else {'PYTHONPATH': os.pathsep.join(filter(None, (
    str(ROOT / 'test' / 'support' / 'desktop'), os.environ.get('PYTHONPATH'))))}

made_at_run_time = pytest.mark.skipif(
    HAS_TF2_MSGS,
    reason='tf2_msgs is installed: its TFMessage is used, none is made at run time')


on_linux = pytest.mark.skipif(
    sys.platform != 'linux', reason='only Linux has /proc and /dev/full')
on_unix = pytest.mark.skipif(
    sys.platform == 'win32', reason='Windows has no such pipes, terminals, signals or names')


def code_without(modules: Iterable[str]) -> str:
    """
    Return code that makes modules impossible to import, as if they were not installed.

    :param modules: the beginnings of their names.
    """
    return (
        'import sys\n'
        'class Others:\n'
        '    def __init__(self, finder):\n'
        '        self.finder = finder\n'
        '    def find_spec(self, name, *args):\n'
        f'        if not name.startswith({tuple(modules)!r}):\n'
        '            return self.finder.find_spec(name, *args)\n'
        'sys.meta_path[:] = map(Others, sys.meta_path)\n')


WITHOUT_ROS = code_without(ROS)

#: The module of each command.
COMMANDS = {
    **{name: f'dummy_arm.{name}' for name in ('check_arm', 'dummy_arm', 'dynamic_tf_publisher')},
    **{path.stem: f'puretf_tools.commands.{path.stem}'
       for path in sorted((ROOT / 'puretf_tools' / 'commands').glob('[a-z]*.py'))}}
