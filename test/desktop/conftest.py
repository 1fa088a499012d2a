"""Fixtures: a ROS domain for each test, processes that always end, a node."""

from processes import domain_id, start  # noqa: F401
from ros_node import closed_context, listening, ros  # noqa: F401
