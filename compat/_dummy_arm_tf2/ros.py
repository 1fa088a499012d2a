"""Raises an ImportError with the remedy if rclpy or the common messages are not installed."""

try:
    import geometry_msgs.msg  # noqa: F401
    import rclpy  # noqa: F401
except ImportError as error:
    raise ImportError(
        f'this module of tf2 needs ROS 2 ({error}): pip install "ros-jazzy-rclpy[fastrtps]" '
        'ros-jazzy-common-interfaces') from None
