"""The module of tf2_geometry_msgs with all its names."""

from tf2_geometry_msgs import *  # noqa: F403
