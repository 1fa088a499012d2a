"""The packages of `compat`, which have the import names of tf2, in programs without ROS."""

from importlib.util import find_spec
import re
import subprocess
import sys

from environment import code_without, HAS_TF2_MSGS, ROOT, ROS
import pytest

from puretf._text.distribution import how_to_install_ros

COMPAT = ROOT / 'compat'
needs_compat = pytest.mark.skipif(
    find_spec('_dummy_arm_tf2') is None or HAS_TF2_MSGS,
    reason='dummy-arm-tf2, of compat, is not installed, or the real tf2_msgs is found first')


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


@needs_compat
def test_without_ros():
    """Exceptions and rotations can be used; everything else is an error of one line."""
    without_ros = code_without(
        name for name in ROS if not name.startswith(('tf', 'sensor_msgs')))
    assert run('-c', without_ros + """
import tf_transformations
from tf2_py import LookupException, TransformException
print(tf_transformations.quaternion_from_euler(0, 0, 0))
for code in ('import tf2_ros', 'import tf2_ros.buffer_client', 'import tf2_geometry_msgs',
             'from tf2_py import BufferCore', 'import tf2_msgs.msg', 'import tf2_sensor_msgs',
             'import sensor_msgs_py.point_cloud2'):
    try:
        exec(code)
        print(code, 'is no error')
    except ImportError as error:
        print(error)
""") == '(0.0, 0.0, 0.0, 1.0)\n' + 7 * (
        f'this needs ROS, but rclpy is not installed: {how_to_install_ros()}. In puretf, '
        'TransformBuffer, Transform, bag and rotations need no ROS\n')


@needs_compat
@pytest.mark.parametrize(('path', 'arguments'), [
    ('dummy_arm.py', ['dummy_arm.py']), ('dummy_arm/dummy_arm.py', ['-m', 'dummy_arm.dummy_arm'])])
def test_a_program_or_package_of_the_user_may_be_called_dummy_arm(tmp_path, path, arguments):
    """Nothing that tf2's packages import has this name; `ros2 pkg create` makes the package."""
    pytest.importorskip('rclpy', reason='tf2_ros needs ROS')
    program = tmp_path / path
    program.parent.mkdir(exist_ok=True)
    (program.parent / '__init__.py').touch()
    program.write_text('from tf2_py import LookupException\nimport tf_transformations\n'
                       'import tf2_ros, tf2_geometry_msgs, tf2_sensor_msgs, tf2_msgs.msg\n'
                       'import sensor_msgs_py.point_cloud2\n'
                       'print(tf2_ros.Buffer().all_frames_as_string() == "")\n')
    assert run(*arguments, cwd=tmp_path) == 'True\n'
