"""Fixtures: a ROS domain for each test, processes that always end, a node."""

from cyclone import handles, libddsc  # noqa: F401
from processes import domain_id, start  # noqa: F401
from ros_node import closed_context, listening, make_node, other, ros, stranger  # noqa: F401
