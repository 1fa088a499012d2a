"""The descriptions of robots by the topics on which they are published, from a bag or a text."""

from collections.abc import Callable
from typing import Optional, Union

from puretf.bag import decoded, Paths
from puretf_tools.robot.description import Description, DescriptionError, MAX_SIZE, parse

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


def in_bag(path: Paths, partial: bool = False,
           on_progress: Optional[Callable[[float], object]] = None) -> dict[str, DescriptionOrWhy]:
    """Return the last description on each topic of a bag; the errors are those of `bag.read`."""
    texts, left_out = dict[str, str](), dict[str, DescriptionOrWhy]()
    for topic, message in decoded(path, STRING, TOPIC, partial=partial, on_progress=on_progress):
        if topic in texts or len(texts) < MOST_TOPICS:
            texts[topic] = message.data[:MAX_SIZE + 1]  # which is refused as too long
        elif not left_out:
            left_out[topic] = f'left out, with any further ones: at most {MOST_TOPICS} are read'
    return {**{topic: parsed(text) for topic, text in texts.items()}, **left_out}
