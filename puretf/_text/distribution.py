"""The distribution of ROS 2 whose packages texts name."""

from importlib.metadata import PackageNotFoundError, version
import os


def distribution() -> str:
    """Return that of the environment, or whose rclpy pip has installed; 'jazzy' if none is."""
    if name := os.environ.get('ROS_DISTRO'):
        return name
    try:
        version('ros-kilted-rclpy')
    except PackageNotFoundError:
        return 'jazzy'
    return 'kilted'


def ros_packages() -> str:
    """Return what `pip install` needs for rclpy and the common messages."""
    name = distribution()
    return f"'ros-{name}-rclpy[fastrtps]' ros-{name}-common-interfaces"


def rclpy_version() -> str:
    """Return the version of rclpy; '' if it is not known."""
    try:
        return version('rclpy')
    except PackageNotFoundError:
        return ''
