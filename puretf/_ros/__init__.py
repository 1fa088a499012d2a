"""What needs ROS. A public module that imports ROS imports this one before, for its error."""

from puretf._text.distribution import require_ros

require_ros()
