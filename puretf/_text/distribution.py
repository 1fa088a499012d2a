"""The distribution of ROS 2 whose packages texts name."""

from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
import os
from platform import machine
import sys


def distribution() -> str:
    """Return that of the environment, or whose rclpy is installed; 'jazzy' if none is."""
    return os.environ.get('ROS_DISTRO') or (
        'kilted' if rclpy_version().startswith('9.') else 'jazzy')


def how_to_install_ros() -> str:
    """Return how to get rclpy and the common messages."""
    name = distribution()
    return (f"pip install 'ros-{name}-rclpy[fastrtps]' ros-{name}-common-interfaces, or source "
            'the setup file of a ROS installation'
            if (sys.platform, machine()) == ('linux', 'x86_64') else
            f'for this platform, PyPI has none, but conda has ROS 2 {name} (RoboStack, '
            'https://robostack.github.io)')


#: The packages that the modules with ROS import.
_ROS = 'rclpy', 'geometry_msgs', 'nav_msgs', 'sensor_msgs', 'std_msgs'


def require_ros(packages: Iterable[str] = _ROS) -> None:
    """Raise an error with the remedy if packages of ROS are not installed."""
    for name in packages:
        if find_spec(name) is None:
            raise ModuleNotFoundError(
                f'this needs ROS, but {name} is not installed: {how_to_install_ros()}. In '
                'puretf, TransformBuffer, Transform, bag and rotations need no ROS', name=name)


def rclpy_version() -> str:
    """Return the version of rclpy; '' if it is not known."""
    try:
        return version('rclpy')
    except PackageNotFoundError:
        return ''
