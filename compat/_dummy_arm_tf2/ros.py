"""Raises an error with the remedy if rclpy or the common messages are not installed."""

from puretf._text.distribution import require_ros

require_ros()
