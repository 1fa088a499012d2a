"""
The packages of `compat`: the import names of tf2, with the names and arguments of the real ones.

data/tf2_api.json has the public names and signatures of the real packages of ROS 2 Jazzy, and of
tf_transformations; those of sensor_msgs_py are from its source. What needs no ROS is in
unit/test_compat.py.
"""

import ast
from importlib import import_module
import inspect
import json
import operator
import re
import subprocess
import sys
from types import ModuleType
from typing import Any

from environment import DATA, HAS_TF2_MSGS
import pytest

import puretf
from puretf import Buffer
import puretf.geometry
import puretf.point_cloud2

pytest.importorskip('_dummy_arm_tf2', reason='dummy-arm-tf2, of compat, is not installed')
if HAS_TF2_MSGS:
    pytest.skip('the real tf2_msgs is found first', allow_module_level=True)

import sensor_msgs_py.point_cloud2
import tf2_geometry_msgs
import tf2_msgs.msg
import tf2_py
import tf2_ros
from tf2_sensor_msgs import tf2_sensor_msgs

API: dict[str, dict[str, Any]] = json.loads((DATA / 'tf2_api.json').read_text())
MESSAGES = {'Point', 'PointStamped', 'PolygonStamped', 'Pose', 'PoseStamped',
            'PoseWithCovarianceStamped', 'TransformStamped', 'Vector3Stamped'}
ALIASES = {'MsgStamped', 'TransformableObject'}
STAMPED = {'PointStamped', 'PoseStamped', 'PoseWithCovarianceStamped', 'TransformStamped',
           'Vector3Stamped'}
LISTENING = {'DurabilityPolicy', 'HistoryPolicy', 'Node', 'QoSProfile', 'ReentrantCallbackGroup',
             'SingleThreadedExecutor'}
#: Names that the real modules have, too. The record has neither aliases of types nor classes that
#: a module imports from another package, although programs import them from there.
UNRECORDED: dict[str, set[str]] = {
    'tf2_ros': {*ALIASES, *STAMPED, *LISTENING, 'Clock', 'Duration', 'Future', 'Header',
                'JumpThreshold', 'Time', 'TimeJump'},
    'tf2_ros.buffer': {'Duration', 'Future', 'JumpThreshold', 'Node', 'Time', 'TimeJump',
                       'TransformStamped'},
    'tf2_ros.buffer_interface': {*ALIASES, *STAMPED, 'Duration', 'Header', 'Time'},
    'tf2_ros.static_transform_broadcaster': {'Node', 'QoSProfile', 'TransformStamped'},
    'tf2_ros.transform_broadcaster': {'Node', 'QoSProfile', 'TransformStamped'},
    'tf2_ros.transform_listener': LISTENING,
    'tf2_geometry_msgs': MESSAGES, 'tf2_geometry_msgs.tf2_geometry_msgs': MESSAGES,
    'tf2_sensor_msgs.tf2_sensor_msgs': {
        'PointCloud2', 'Transform', 'TransformStamped', 'create_cloud', 'read_points'},
    'sensor_msgs_py.point_cloud2': {'Header', 'PointCloud2', 'PointField'}}
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


def test_a_buffer_shows_what_tf2_and_the_reference_have():
    """Nothing of the engine is an attribute of a buffer."""
    names = {name for name in dir(Buffer()) if not name.startswith('_')}
    real = {*API['tf2_ros']['Buffer'], *API['tf2_ros']['BufferInterface'],
            *API['tf2_py']['BufferCore']}
    assert names - real == {
        'chain', 'clock', 'dump', 'frame_names', 'frames', 'insert', 'insert_many', 'jump_handle',
        'lookup_all', 'lookup_transforms', 'lookup_twist', 'path_edges', 'path_stamps',
        'registration', 'remove', 'updated', 'why_not'}


def test_they_are_re_exports():
    """There is one implementation: classes of both names are the same."""
    assert tf2_ros.Buffer is puretf.Buffer
    assert tf2_ros.BufferCore is tf2_py.BufferCore is puretf.BufferCore
    assert tf2_ros.LookupException is tf2_py.LookupException is puretf.LookupException
    assert tf2_msgs.msg.TFMessage is tf2_ros.TFMessage is puretf.TFMessage
    assert tf2_geometry_msgs.do_transform_pose is puretf.geometry.do_transform_pose
    assert sensor_msgs_py.point_cloud2.read_points is puretf.point_cloud2.read_points
    assert tf2_sensor_msgs.create_cloud is puretf.point_cloud2.create_cloud
    with pytest.raises(AttributeError, match="no attribute 'Unknown'"):
        tf2_py.Unknown  # noqa: B018


def test_a_package_imports_its_modules_on_first_use():
    """Otherwise threads that import it and its modules at the same time wait for each other."""
    packages = 'tf2_geometry_msgs', 'tf2_ros', 'tf2_sensor_msgs'
    modules = [name for name in API if name.startswith(tuple(f'{each}.' for each in packages))]
    assert {name.partition('.')[0] for name in modules} == {*packages}
    subprocess.run([sys.executable, '-c', f"""if True:
        import sys, {', '.join(packages)}
        assert not {{*sys.modules}} & {{*{modules}}}
        for package, _, name in (each.partition('.') for each in {modules}):
            assert getattr(sys.modules[package], name) is sys.modules[package + '.' + name]
    """], check=True, timeout=60)
    for package in packages:
        with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'unknown'"):
            import_module(package).unknown  # noqa: B018


@pytest.mark.parametrize('use', [
    lambda: tf2_ros.BufferClient(),
    lambda: tf2_ros.FrameGraph.Request(),
    lambda: tf2_ros.LookupTransform.Goal,
    lambda: tf2_msgs.msg.TF2Error(),
    lambda: tf2_msgs.msg.TF2Error.NO_ERROR])
def test_what_is_not_available(use):
    """It can be imported; its use is one clear error."""
    with pytest.raises((AttributeError, NotImplementedError), match=(
            r'needs services and actions of tf2_msgs, which only ROS has\. .* use a Buffer and a '
            r'TransformListener')) as caught:
        use()
    assert '\n' not in str(caught.value)
