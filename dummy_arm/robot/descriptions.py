"""The descriptions of robots by the topics on which they are published, from a bag or a text."""

from collections.abc import Callable
from typing import Optional, Union

from dummy_arm.robot.description import Description, DescriptionError, parse
from dummy_arm.tf.bag import last_strings, Paths

#: The last part of the names of the topics.
TOPIC = 'robot_description'
#: A description, or why it is refused (one line).
DescriptionOrWhy = Union[Description, str]


def parsed(text: str) -> DescriptionOrWhy:
    """Parse a URDF text."""
    try:
        return parse(text)
    except DescriptionError as error:
        return str(error)


def in_bag(path: Paths, partial: bool = False,
           on_progress: Optional[Callable[[float], object]] = None) -> dict[str, DescriptionOrWhy]:
    """Return the last description on each topic of a bag; see `bag.last_strings`."""
    texts = last_strings(path, TOPIC, partial=partial, on_progress=on_progress)
    return {topic: parsed(text) for topic, text in texts.items()}
