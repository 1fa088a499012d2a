"""Fixtures: a ROS domain for each test, processes that always end, a node."""

from processes import browse, domain_id, start  # noqa: F401
from ros_node import closed_context, listening, make_node, other, ros, stranger  # noqa: F401
