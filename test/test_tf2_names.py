"""
The packages of `compat`: the import names of tf2, with the names and arguments of the real ones.

data/tf2_api.json has the public names and signatures of the real packages of ROS 2 Jazzy, and of
tf_transformations.
"""

import ast
from importlib import import_module
import inspect
import json
import operator
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
from types import ModuleType
from typing import Any

from conftest import code_without, made_at_run_time
from imports import ROS
import pytest
from rclpy.action.client import ActionClient
import tf2_geometry_msgs
import tf2_msgs.msg
import tf2_py
import tf2_ros

import dummy_arm.tf
import dummy_arm.tf.geometry

ROOT = Path(__file__).parent.parent
COMPAT = ROOT / 'compat'

API: dict[str, dict[str, Any]] = json.loads(
    (Path(__file__).parent / 'data' / 'tf2_api.json').read_text())
MESSAGES = {'PointStamped', 'PolygonStamped', 'Pose', 'PoseStamped', 'PoseWithCovarianceStamped',
            'TransformStamped', 'Vector3Stamped'}
ALIASES = {'MsgStamped', 'TransformableObject'}
STAMPED = {'PointStamped', 'PoseStamped', 'PoseWithCovarianceStamped', 'TransformStamped',
           'Vector3Stamped'}
#: Names that the real modules have, too. The record has neither aliases of types nor classes that
#: a module imports from another package, although programs import them from there.
UNRECORDED: dict[str, set[str]] = {
    'tf2_ros': {*ALIASES, *STAMPED, 'Duration', 'Header', 'Node', 'QoSProfile', 'Time'},
    'tf2_ros.buffer': {'Duration', 'Node', 'Time', 'TransformStamped'},
    'tf2_ros.buffer_interface': {*ALIASES, *STAMPED, 'Duration', 'Header', 'Time'},
    'tf2_ros.static_transform_broadcaster': {'Node', 'QoSProfile', 'TransformStamped'},
    'tf2_ros.transform_broadcaster': {'Node', 'QoSProfile', 'TransformStamped'},
    'tf2_ros.transform_listener': {'Node', 'QoSProfile'},
    'tf2_geometry_msgs': MESSAGES, 'tf2_geometry_msgs.tf2_geometry_msgs': MESSAGES}
#: The classes that cannot be provided without services and actions of tf2_msgs.
UNAVAILABLE = ['BufferClient', 'FrameGraph', 'LookupTransform']


def public_names(module: ModuleType) -> set[str]:
    """Return the names that `from module import *` imports, without submodules."""
    return {name for name in getattr(module, '__all__', vars(module))
            if not name.startswith('_') and not isinstance(getattr(module, name), ModuleType)}


def calls(signature: str) -> list[tuple[list[str], list[str]]]:
    """Return calls that fit the text of a signature, as positional and keyword arguments."""
    definition, = ast.parse(f'def function{signature}: pass').body
    assert isinstance(definition, ast.FunctionDef)
    arguments = definition.args
    names = [argument.arg for argument in arguments.args if argument.arg != 'self']
    keywords = [argument.arg for argument in arguments.kwonlyargs]
    required = names[:len(names) - len(arguments.defaults)]
    more = ['one', 'two'] if arguments.vararg else []
    return [(names + more, keywords), ([], names + keywords), (required, []), ([], required)]


@pytest.mark.parametrize('name', API)
def test_a_module_has_the_names_of_the_real_one(name):
    """It has no name more and no name less."""
    assert public_names(import_module(name)) == API[name].keys() | UNRECORDED.get(name, set())


FUNCTIONS = [(module, f'{name}.{member}'.strip('.'), signature)
             for module, names in API.items() for name, members in names.items()
             for member, signature in (
                 members.items() if isinstance(members, dict) else [('', members)])
             if (name not in (*UNAVAILABLE, 'TF2Error', 'TFMessage') and '(self' in signature
             and not re.match('_[A-Za-z]', member) and '/' not in signature)
             or (not member and '(' in signature)]


@pytest.mark.parametrize(('module', 'name', 'signature'), FUNCTIONS)
def test_every_call_of_the_real_one_fits(module, name, signature):
    """The parameters have the same names and order; what may be left out may be left out."""
    function = operator.attrgetter(name)(import_module(module))
    own = inspect.signature(function)
    for positional, keywords in calls(signature):
        if 'self' in own.parameters:
            positional = ['self', *positional]
        own.bind(*positional, **dict.fromkeys(keywords))


@pytest.mark.parametrize('module', API)
def test_a_class_has_the_methods_of_the_real_one(module):
    """This holds for the private methods of BufferCore, too, which programs call."""
    for name, members in API[module].items():
        if isinstance(members, dict) and name not in (*UNAVAILABLE, 'TF2Error'):
            own = getattr(import_module(module), name)
            assert not [member for member in members if not hasattr(own, member)
                        and (not member.startswith('_') or name == 'BufferCore')]


def test_they_are_re_exports():
    """There is one implementation: classes of both names are the same."""
    assert tf2_ros.Buffer is dummy_arm.tf.Buffer
    assert tf2_ros.BufferCore is tf2_py.BufferCore is dummy_arm.tf.MessageBufferCore
    assert tf2_ros.LookupException is tf2_py.LookupException is dummy_arm.tf.LookupException
    assert tf2_msgs.msg.TFMessage is tf2_ros.TFMessage is dummy_arm.tf.TFMessage
    assert tf2_geometry_msgs.do_transform_pose is dummy_arm.tf.geometry.do_transform_pose
    with pytest.raises(AttributeError, match="no attribute 'Unknown'"):
        tf2_py.Unknown  # noqa: B018


@pytest.mark.parametrize('use', [
    lambda node: tf2_ros.BufferClient(),
    lambda node: tf2_ros.FrameGraph.Request(),
    lambda node: tf2_ros.LookupTransform.Goal,
    lambda node: tf2_msgs.msg.TF2Error(),
    lambda node: tf2_msgs.msg.TF2Error.NO_ERROR,
    lambda node: node.create_client(tf2_ros.FrameGraph, 'tf2_frames'),
    lambda node: ActionClient(node, tf2_ros.LookupTransform, 'tf2_buffer_server')])
@made_at_run_time
def test_what_is_not_available(ros, use):
    """It can be imported; its use is one clear error."""
    with pytest.raises((AttributeError, NotImplementedError), match=(
            r'needs services and actions of tf2_msgs, which only ROS has\. .* use a Buffer and a '
            r'TransformListener')) as caught:
        use(ros.node)
    assert '\n' not in str(caught.value)


@made_at_run_time
@pytest.mark.parametrize('name', ['srv', 'action'])
def test_services_and_actions_are_not_there(name):
    """Programs that ask whether they are there get the usual answer."""
    with pytest.raises(ModuleNotFoundError):
        import_module(f'tf2_msgs.{name}')


def run(code, **kwargs):
    """Run code in a new process, and return what it has printed."""
    result = subprocess.run([sys.executable, '-c', code], text=True, capture_output=True,
                            timeout=60, **kwargs)
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_without_ros():
    """Exceptions and rotations can be used; everything else is an error of one line."""
    without_ros = code_without(name for name in ROS if not name.startswith('tf'))
    assert run(without_ros + """
import tf_transformations
from tf2_py import LookupException, TransformException
print(tf_transformations.quaternion_from_euler(0, 0, 0))
for code in ('import tf2_ros', 'import tf2_ros.buffer_client', 'import tf2_geometry_msgs',
             'from tf2_py import BufferCore', 'import tf2_msgs.msg', 'import tf2_sensor_msgs'):
    try:
        exec(code)
        print(code, 'is no error')
    except ImportError as error:
        print(error)
""") == '(0.0, 0.0, 0.0, 1.0)\n' + 6 * (
        'this module of tf2 needs ROS 2, but geometry_msgs is not installed: pip install '
        '"ros-jazzy-rclpy[fastrtps]" ros-jazzy-common-interfaces\n')


def test_the_real_packages_win(tmp_path):
    """Where ROS is sourced, its packages are found first, and dummy_arm.tf uses its TFMessage."""
    for name in 'tf2_ros', 'tf2_py', 'tf2_msgs', 'tf2_geometry_msgs', 'tf_transformations':
        (tmp_path / name).mkdir()
        (tmp_path / name / '__init__.py').write_text('REAL = True\n')
    for name, text in (('srv', 'class FrameGraph: pass'), ('msg', 'class TFMessage: pass'),
                       ('tf2_msgs_s__rosidl_typesupport_c.so', '')):
        (tmp_path / 'tf2_msgs' / (name if '.' in name else f'{name}.py')).write_text(text)
    assert run(
        'import tf2_ros, tf2_py, tf2_msgs, tf2_geometry_msgs, tf_transformations\n'
        'assert tf2_ros.REAL and tf2_py.REAL and tf2_msgs.REAL and tf2_geometry_msgs.REAL\n'
        'assert tf_transformations.REAL\n'
        'from dummy_arm.tf import TFMessage; print(TFMessage.__module__)',
        env={**os.environ, 'PYTHONPATH': str(tmp_path)}) == 'tf2_msgs.msg\n'


USE = 'import tf2_ros; from dummy_arm.tf import Buffer; assert tf2_ros.Buffer is Buffer'


@pytest.mark.parametrize(('files', 'program', 'printed'), [
    # A program called dummy_arm.py; the same by -m; a program beside it.
    ({'dummy_arm.py': USE}, ['dummy_arm.py'], ''),
    ({'dummy_arm.py': USE}, ['-m', 'dummy_arm'], ''),
    ({'dummy_arm.py': 'raise RuntimeError', 'beside.py': USE}, ['beside.py'], ''),
    ({'dummy_arm.py': 'raise RuntimeError', 'beside.py': USE}, ['-m', 'beside'], ''),
    ({'dummy_arm.py': 'raise RuntimeError'}, ['-c', USE], ''),
    # A program that is imported by another one, such as a test of it.
    ({'dummy_arm.py': 'import tf2_ros\nanswer = 42',
      'test.py': 'import dummy_arm, tf2_ros; print(dummy_arm.answer)'}, ['test.py'], '42\n'),
    ({'dummy_arm.py': 'import tf2_ros\nanswer = 42; print("executed")',
      'test.py': 'import tf2_ros, dummy_arm; print(dummy_arm.answer, dummy_arm.answer)'},
     ['test.py'], 'executed\n42 42\n'),
    ({'dummy_arm.py': 'answer = 42',
      'test.py': f'{USE}\nfrom dummy_arm import answer; print(answer)\ntry:\n'
                 '    from dummy_arm import nothing\nexcept ImportError as e:\n    print(e.name)'},
     ['test.py'], '42\ndummy_arm\n'),
    ({'dummy_arm.py': 'import tf2_ros\nLIMIT = 1\ndef limit():\n    return LIMIT',
      'test.py': 'import tf2_ros, dummy_arm\ndummy_arm.LIMIT = 2; print(dummy_arm.limit())\n'
                 'from dummy_arm import *; print(limit(), "LIMIT" in dir(dummy_arm))'},
     ['test.py'], '2\n2 True\n'),
    ({'dummy_arm.py': 'import tf2_ros\ntf2_ros.Bufer',
      'test.py': 'import tf2_ros\nfor _ in range(2):\n    try:\n        from dummy_arm import f\n'
                 '    except ImportError as error:\n        print(error.__cause__)'},
     ['test.py'], 2 * "module 'tf2_ros' has no attribute 'Bufer'\n"),
    # A directory of that name that is no package, such as a clone of this project.
    ({'dummy_arm.py': USE, 'dummy_arm/README.md': ''}, ['dummy_arm.py'], ''),
    ({'dummy_arm/README.md': '', 'beside.py': USE}, ['beside.py'], ''),
    # A package of that name, as `ros2 pkg create` makes it.
    ({'dummy_arm/__init__.py': '', 'dummy_arm/dummy_arm.py': USE},
     ['-m', 'dummy_arm.dummy_arm'], ''),
    ({'dummy_arm/__init__.py': '', 'dummy_arm/dummy_arm.py': USE}, ['dummy_arm/dummy_arm.py'], ''),
    ({'dummy_arm/__init__.py': '', 'dummy_arm/dummy_arm.py': f'{USE}\nanswer = 42',
      'test.py': 'from dummy_arm.dummy_arm import answer; print(answer)'}, ['test.py'], '42\n')])
def test_a_program_with_the_name_of_the_package(tmp_path, files, program, printed):
    """`import tf2_ros` finds the package dummy_arm, and not the program of the user."""
    for name, code in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(code + '\n')
    result = subprocess.run([sys.executable, *program], cwd=tmp_path, text=True,
                            capture_output=True, timeout=60)
    assert (result.returncode, result.stdout, result.stderr) == (0, printed, '')


def test_where_the_package_is_not_installed():
    """The error is one line."""
    assert run(f"""
import collections.abc, importlib.machinery, importlib.util, sys, threading, types, typing
spec = importlib.util.spec_from_file_location(
    '_dummy_arm_tf2', {str(COMPAT / '_dummy_arm_tf2' / '__init__.py')!r})
module = importlib.util.module_from_spec(spec)
sys.path.clear()
sys.meta_path.clear()
try:
    spec.loader.exec_module(module)
except ImportError as error:
    print(error)
""") == 'the package dummy_arm is not installed; see its README\n'


def test_the_versions_are_equal():
    """One release has both distributions, each with the version and the licence."""
    version = re.search(r"version='(.*)'", (ROOT / 'setup.py').read_text())
    project = (COMPAT / 'pyproject.toml').read_text()
    assert version is not None
    assert f"version = '{version[1]}'" in project
    assert f"'dummy_arm=={version[1]}'" in project
    assert (COMPAT / 'LICENSE').read_text() == (ROOT / 'LICENSE').read_text()


@pytest.mark.soak
def test_the_wheel(tmp_path):
    """A wheel is built, and a program uses what is installed from it."""
    wheels, installed = tmp_path / 'wheels', tmp_path / 'installed'
    shutil.copytree(COMPAT, tmp_path / 'compat',
                    ignore=shutil.ignore_patterns('*.egg-info', 'build'))
    pip = [sys.executable, '-m', 'pip', '--quiet', '--disable-pip-version-check']
    subprocess.run([*pip, 'wheel', '--no-deps', '--wheel-dir', wheels, tmp_path / 'compat'],
                   check=True, timeout=120)
    wheel, = wheels.iterdir()
    subprocess.run([*pip, 'install', '--no-deps', '--target', installed, wheel], check=True,
                   timeout=120)
    assert run(
        'import tf2_geometry_msgs, tf2_msgs.msg, tf2_py, tf2_ros, tf2_sensor_msgs\n'
        'import tf_transformations\n'
        'print(tf2_ros.__file__)\n' + USE, env={**os.environ, 'PYTHONPATH': str(installed)}
    ) == f'{installed / "tf2_ros" / "__init__.py"}\n'
    assert sorted(path.name for path in installed.iterdir() if not path.name.startswith('_')) == [
        'dummy_arm_tf2-0.2.0.dist-info', 'tf2_geometry_msgs', 'tf2_msgs', 'tf2_py', 'tf2_ros',
        'tf2_sensor_msgs', 'tf_transformations']
