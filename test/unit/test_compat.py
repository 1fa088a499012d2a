"""The packages of `compat`, which have the import names of tf2, in programs without ROS."""

from importlib.util import find_spec
import re
import subprocess
import sys

from environment import code_without, HAS_TF2_MSGS, ROOT, ROS
import pytest

COMPAT = ROOT / 'compat'
needs_compat = pytest.mark.skipif(
    find_spec('_dummy_arm_tf2') is None or HAS_TF2_MSGS,
    reason='dummy-arm-tf2, of compat, is not installed, or the real tf2_msgs is found first')
USE = ('from tf2_py import LookupException; from dummy_arm import tf; '
       'assert LookupException is tf.LookupException')


def run(*arguments, **kwargs):
    """Run python in a new process, and return what it has printed."""
    done = subprocess.run([sys.executable, *arguments], text=True, capture_output=True,
                          timeout=60, check=False, **kwargs)
    assert (done.returncode, done.stderr) == (0, '')
    return done.stdout


def test_the_versions_are_equal():
    """One release has both distributions, each with the version and the licence."""
    version = re.search(r"version='(.*)'", (ROOT / 'setup.py').read_text())
    project = (COMPAT / 'pyproject.toml').read_text()
    assert version is not None
    assert f"version = '{version[1]}'" in project
    assert f"'dummy_arm=={version[1]}'" in project
    assert (COMPAT / 'LICENSE').read_text() == (ROOT / 'LICENSE').read_text()


def test_where_the_package_is_not_installed():
    """The error is one line."""
    assert run('-c', f"""if True:
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


@needs_compat
def test_without_ros():
    """Exceptions and rotations can be used; everything else is an error of one line."""
    without_ros = code_without(name for name in ROS if not name.startswith('tf'))
    assert run('-c', without_ros + """
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


@needs_compat
@pytest.mark.parametrize(('files', 'program', 'printed'), [
    # A program of that name, which is not executed twice; another one in its directory.
    ({'dummy_arm.py': f'{USE}\nprint("executed")'}, ['dummy_arm.py'], 'executed\n'),
    ({'dummy_arm.py': 'raise RuntimeError'}, ['-c', USE], ''),
    # A program that is imported by another one, such as a test of it.
    ({'dummy_arm.py': 'import tf2_py\nanswer = 42',
      'test.py': 'import dummy_arm, tf2_py; print(dummy_arm.answer)'}, ['test.py'], '42\n'),
    ({'dummy_arm.py': 'import tf2_py\nanswer = 42; print("executed")',
      'test.py': 'import tf2_py, dummy_arm; print(dummy_arm.answer, dummy_arm.answer)'},
     ['test.py'], 'executed\n42 42\n'),
    ({'dummy_arm.py': 'answer = 42',
      'test.py': f'{USE}\nfrom dummy_arm import answer; print(answer)\ntry:\n'
                 '    from dummy_arm import nothing\nexcept ImportError as e:\n    print(e.name)'},
     ['test.py'], '42\ndummy_arm\n'),
    ({'dummy_arm.py': 'import tf2_py\nLIMIT = 1\ndef limit():\n    return LIMIT',
      'test.py': 'import tf2_py, dummy_arm\ndummy_arm.LIMIT = 2; print(dummy_arm.limit())\n'
                 'from dummy_arm import *; print(limit())'}, ['test.py'], '2\n2\n'),
    ({'dummy_arm.py': 'LIMIT = 1',
      'test.py': 'import tf2_py, dummy_arm; print("LIMIT" in dir(dummy_arm))'},
     ['test.py'], 'True\n'),
    ({'dummy_arm.py': 'import tf2_py\ntf2_py.Bufer',
      'test.py': 'import tf2_py\nfor _ in range(2):\n    try:\n        from dummy_arm import f\n'
                 '    except ImportError as error:\n        print(error.__cause__)'},
     ['test.py'], 2 * "module 'tf2_py' has no attribute 'Bufer'\n"),
    # A package of that name, as `ros2 pkg create` makes it.
    ({'dummy_arm/__init__.py': '', 'dummy_arm/dummy_arm.py': USE},
     ['-m', 'dummy_arm.dummy_arm'], ''),
    ({'dummy_arm/__init__.py': '', 'dummy_arm/dummy_arm.py': 'answer = 42',
      'test.py': f'{USE}\nfrom dummy_arm.dummy_arm import answer; print(answer)'},
     ['test.py'], '42\n')])
def test_a_program_with_the_name_of_the_package(tmp_path, files, program, printed):
    """The packages of tf2 find the package dummy_arm, and not the program of the user."""
    for name, code in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(code + '\n')
    assert run(*program, cwd=tmp_path) == printed
