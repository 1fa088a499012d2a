"""Raises an error with the remedy if rclpy or the common messages are not installed."""

from importlib import import_module

from puretf._text.distribution import ros_packages

try:
    for _name in 'geometry_msgs', 'nav_msgs', 'rclpy', 'sensor_msgs', 'std_msgs':
        import_module(_name)
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f'this module needs ROS 2, but {error.name} is not installed: pip install '
        f'{ros_packages()}', name=error.name) from None
