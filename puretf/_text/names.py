"""Names for texts, escaped and abbreviated, and the sections of docs/troubleshooting.md."""

from collections.abc import Callable, Sequence
from posixpath import relpath

#: The name of the type TFMessage, in the ROS graph and in bags of rosbag2.
TF_MESSAGE = 'tf2_msgs/msg/TFMessage'
#: The longest name (characters) that a log line shows in full.
LONGEST = 100
#: The largest size that a frame's name may have (bytes of UTF-8).
LONGEST_NAME = 1024
#: The number of names that a text lists.
SHOWN = 5


def visible(text: str) -> str:
    """
    Escape each character of a line that is not printable, as `repr` does.

    A control character can move the cursor of a terminal; a lone surrogate is not valid UTF-8.
    """
    return text if text.isprintable() else ''.join(
        c if c.isprintable() else repr(c)[1:-1] for c in text)


def abbreviated(text: str, longest: int = LONGEST) -> str:
    """Replace the middle of a text of more than `longest` characters (from 3 on) by dots."""
    if len(text) <= longest:
        return text
    kept = longest - 3
    return f'{text[:kept - kept // 2]}...{text[len(text) - kept // 2:]}'


def shortened(name: str, longest: int = LONGEST) -> str:
    """Abbreviate and escape a name; if it begins or ends with a blank, add quotes."""
    name = abbreviated(name, longest)
    return repr(name) if name[:1] == ' ' or name[-1:] == ' ' else visible(name)


def quoted(name: str) -> str:
    """Abbreviate a name, and add quotes and escape sequences as `repr` does."""
    return repr(abbreviated(name))


def dot_quoted(name: str) -> str:
    """Return a name in double quotes, as an identifier of the DOT language."""
    return f'"{dot_escaped(name)}"'


def dot_escaped(text: str) -> str:
    """Escape a text for use between double quotes in DOT."""
    return text.replace('\\', '\\\\').replace('"', '\\"').replace('\n', '\\n')


def is_too_long(name: str) -> bool:
    """Return True if a name is too long for a frame: more than 1024 bytes in UTF-8."""
    return len(name.encode('utf-8', 'surrogatepass')) > LONGEST_NAME


def comma_list(texts: Sequence[str], write: Callable[[str], str] = str, shown: int = SHOWN) -> str:
    """
    Join the first texts with commas, each converted by `write`, and say how many remain.

    >>> comma_list(['a', 'b', 'c', 'd'], shown=2)
    'a, b and 2 more'
    """
    more = f' and {len(texts) - shown} more' if len(texts) > shown else ''
    return f'{", ".join(map(write, texts[:shown]))}{more}'


#: By short name: the headings of the sections of docs/troubleshooting.md.
SECTIONS = {
    'future': 'Extrapolation into the future',
    'past': 'Extrapolation into the past',
    'gap': 'A gap in the data',
    'one_time': 'Only one time is in the buffer',
    'missing_frame': 'A frame does not exist',
    'two_trees': 'Two unconnected trees',
    'old_data': 'TF_OLD_DATA',
    'repeated_data': 'TF_REPEATED_DATA',
    'full_queue': 'The queue of a message filter is full',
    'old_messages': 'Messages are earlier than all data in the cache',
    'clock': 'use_sim_time and the wall clock',
    'tf_static': 'The QoS of /tf_static',
    'split_bag': 'No static transforms from a bag',
    'damaged_bag': 'A bag cannot be read',
    'jump': 'A frame jumps or flickers',
    'jump_back': 'A jump back in time',
    'namespace': 'A leading slash, or a namespace',
    'half_namespace': 'Half of a robot is in a namespace',
    'two_nodes': 'Two nodes on /joint_states or /clock',
    'own_node': 'A lookup that waits for its own node',
    'other': 'Other faults'}


def see(section: str) -> str:
    """
    Return the end of a hint: the command that prints a section of docs/troubleshooting.md.

    There is no period after the command, so that it can be copied.

    >>> see('old_data')
    ' More: tf_doctor --explain old_data'
    """
    return f' More: tf_doctor --explain {section}'


def namespace_path(namespace: str) -> str:
    """Return a namespace as the beginning of the name of a topic."""
    return ''.join(f'/{part}' for part in namespace.split('/') if part)


def namespace_distance(namespace: str, other: str) -> int:
    """
    Return the number of steps, up and down, from one namespace to another.

    >>> namespace_distance('/lab/robot1', '/lab'), namespace_distance('/robot1', '/robot2')
    (1, 2)
    """
    steps = relpath(f'/{namespace}', f'/{other}').split('/')
    return 0 if steps == ['.'] else len(steps)


def full_name(namespace: str, name: str) -> str:
    """Return the full name of a node, whose namespace begins with a slash."""
    return f'{namespace.rstrip("/")}/{name}'
