"""The descriptions of robots by the topics on which they are published."""

from typing import Union

from puretf_tools.robot.description import Description, parse
from puretf_tools.robot.urdf_text import DescriptionError

#: The last part of the names of the topics.
TOPIC = 'robot_description'
STRING = 'std_msgs/msg/String'
#: The largest number of topics with descriptions at a time.
MOST_TOPICS = 20
#: A description, or why it is refused (one line).
DescriptionOrWhy = Union[Description, str]


def parsed(text: str) -> DescriptionOrWhy:
    """Parse a URDF text."""
    try:
        return parse(text)
    except DescriptionError as error:
        return str(error)
