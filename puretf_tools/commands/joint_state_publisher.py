"""The command `joint_state_publisher`: publish the positions of joints, set by sliders."""

from collections.abc import Mapping, Sequence
import os
from pathlib import Path
from typing import Optional

from puretf._text.names import shortened
from puretf_tools.cli.description_file import run_with_file
from puretf_tools.cli.node import spinning_node
from puretf_tools.cli.page_options import add_page_options
from puretf_tools.cli.parser import Parser
from puretf_tools.robot import parse, read
from puretf_tools.robot.observed import TOPIC


def command(file: Optional[str], arguments: Mapping[str, str], host: str, port: Optional[int],
            meshes: Sequence[str], namespace: str, ros_args: Sequence[str]) -> int:
    """Publish the joints of a file, or of the topic robot_description, until a signal."""
    description = None
    if file is not None:
        description = parse(read(file, arguments))
        # The names of meshes are often relative to the file, such as ../meshes/hand.stl.
        meshes = [*meshes, *map(str, Path(os.path.abspath(file)).parents[:2])]
    from puretf_tools.robot.joint_senders import JointStatePublisher
    from puretf_tools.view.feed import LiveFeed
    from puretf_tools.view.server import serve
    from puretf_tools.view.view import show
    with spinning_node('joint_state_publisher', ros_args, namespace) as node:
        topic = node.resolve_topic_name(TOPIC)
        if not description:
            node.get_logger().info(f'waiting for a robot description on {shortened(topic)}')
        # With a file, what the network sends is not parsed.
        feed = LiveFeed(node, JointStatePublisher(node),
                        {topic: description} if description else None)
        with serve(host, port) as server:
            show(feed, server, meshes)
    return 0


def main(args: Optional[Sequence[str]] = None) -> int:
    parser = Parser(
        'joint_state_publisher', 'Publish the positions of the joints of a robot on joint_states, '
        'until Ctrl-C. Sliders on\na page in the browser set them.',
        'parameters, set by --ros-args -p NAME:=VALUE:\n'
        '  rate          rate of the messages (Hz; 0.1 to 1000; default 10)\n'
        '  use_sim_time  take the time from /clock (default false)\n\n'
        'examples: joint_state_publisher\n          joint_state_publisher my_robot.urdf')
    add_page_options(parser)
    return run_with_file(parser, command, args, 'the description on robot_description')
