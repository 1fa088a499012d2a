"""The command `robot_state_publisher`: publish the transforms of a robot that URDF describes."""

from collections.abc import Mapping, Sequence
from typing import Optional

from puretf_tools.cli.description_file import run_with_file
from puretf_tools.cli.node import run_node
from puretf_tools.cli.parser import Parser, UsageError
from puretf_tools.robot import read
from puretf_tools.robot.state_publisher import RobotStatePublisher


def command(file: Optional[str], arguments: Mapping[str, str], namespace: str,
            ros_args: Sequence[str]) -> int:
    """Publish the robot of a file, or of the parameter robot_description, until a signal."""
    text = '' if file is None else read(file, arguments)

    def make_node() -> RobotStatePublisher:
        try:
            return RobotStatePublisher(text)
        except ValueError as error:
            raise UsageError(str(error)) from None

    return run_node(make_node, ros_args, namespace)


def main(args: Optional[Sequence[str]] = None) -> int:
    parser = Parser(
        'robot_state_publisher', 'Publish the transforms of a robot, until Ctrl-C: fixed joints '
        'on /tf_static, the others\non /tf as soon as their positions arrive on joint_states.',
        'parameters, set by --ros-args -p NAME:=VALUE, also while the node runs:\n'
        '  robot_description  the URDF text, instead of the file\n'
        '  publish_frequency  the most messages per second on /tf (Hz; 0 to 1000, 0: no limit;\n'
        '                     default 20)\n'
        '  frame_prefix       prefix of every frame name, such as robot1/\n'
        '  ignore_timestamp   answer to every message on joint_states (default false)\n'
        '  use_sim_time       take the time from /clock (default false)\n\n'
        'examples: robot_state_publisher my_robot.urdf --ros-args -p publish_frequency:=50\n'
        '          robot_state_publisher my_robot.urdf.xacro length:=0.5')
    return run_with_file(parser, command, args)
