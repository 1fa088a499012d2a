"""Fixtures: a ROS domain for each test, processes that always end, a node, an arm to read."""

from cli_runner import arm_domain  # noqa: F401
from cyclone import handles, libddsc  # noqa: F401
from processes import browse, domain_id, start  # noqa: F401
from ros_node import closed_context, listening, make_node, other, ros, stranger  # noqa: F401
