"""The entry points of the commands of the arm and the lab."""

from puretf_tools.cli.entry_point import entry_point
from puretf_tools.cli.signals import signals_blocked

# Threads that libraries of check_arm start keep signals blocked, so that only the main thread
# takes them: it needs to know who has sent them.
check_arm = entry_point('dummy_arm.check_arm', interrupted=1, context=signals_blocked)
dummy_arm = entry_point('dummy_arm.dummy_arm')
dynamic_tf_publisher = entry_point('dummy_arm.dynamic_tf_publisher')
