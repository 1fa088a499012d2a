"""Raises an error with the remedy if rclpy or the common messages are not installed."""

try:
    import geometry_msgs  # noqa: F401
    import nav_msgs  # noqa: F401
    import rclpy  # noqa: F401
    import sensor_msgs  # noqa: F401
    import std_msgs  # noqa: F401
except ModuleNotFoundError as error:
    if error.name not in ('geometry_msgs', 'nav_msgs', 'rclpy', 'sensor_msgs', 'std_msgs'):
        raise
    raise ModuleNotFoundError(
        f'this module needs ROS 2, but {error.name} is not installed: pip install '
        '"ros-jazzy-rclpy[fastrtps]" ros-jazzy-common-interfaces', name=error.name) from None
