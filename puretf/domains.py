"""The ROS domains in which processes of this machine take part; Linux only."""

from puretf._ros.domains import command_of, ros_domains, short_command, used_domains

__all__ = ['command_of', 'ros_domains', 'short_command', 'used_domains']
