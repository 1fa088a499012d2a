"""The entry points of the commands; CONTRIBUTING.md lists the steps to add a command."""

from puretf_tools.cli.entry_point import entry_point

joint_state_publisher = entry_point('puretf_tools.commands.joint_state_publisher')
param = entry_point('puretf_tools.commands.param')
robot_state_publisher = entry_point('puretf_tools.commands.robot_state_publisher')
static_transform_publisher = entry_point('puretf_tools.commands.static_transform_publisher')
tf2_echo = entry_point('puretf_tools.commands.tf2_echo')
tf2_monitor = entry_point('puretf_tools.commands.tf2_monitor')
tf_doctor = entry_point('puretf_tools.commands.tf_doctor')
tf_trajectory = entry_point('puretf_tools.commands.tf_trajectory')
view_frames = entry_point('puretf_tools.commands.view_frames')
web_view = entry_point('puretf_tools.commands.web_view')
