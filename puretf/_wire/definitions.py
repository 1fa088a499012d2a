"""What bags record of the messages on a topic: the definition of their type, and the QoS."""

from functools import lru_cache
import re
from typing import Optional

LONGEST_YAML = 1_000_000  # bytes
#: The begin of an alias, an anchor, a tag or a merge key, where a node of YAML may begin.
_ENDLESS = re.compile(r'(^|-[ \t]|[?:,[{\r\n\x85\u2028\u2029\ufeff])[ \t]*([&*!]|<<)')


def checked_yaml(data: bytes) -> str:
    """Decode YAML of a bag; refuse what can take endless time, and rosbag2 never writes."""
    if len(data) > LONGEST_YAML:
        raise ValueError(f'it has more than {LONGEST_YAML} bytes')
    text = data.decode(errors='replace')
    if _ENDLESS.search(text):
        raise ValueError('it has an alias, an anchor, a tag or a merge key')
    return text


@lru_cache(maxsize=1000)
def begins_with_header(msgtype: str, definition: str) -> Optional[bool]:
    """Return whether messages begin with a header; None: the definition is not understood."""
    from rosbags.typesys import get_types_from_idl, get_types_from_msg, get_typestore, Stores
    try:
        if not definition:
            types = get_typestore(Stores.LATEST).fielddefs
        elif re.search(r'\bmodule\s+\w+\s*{', definition):
            types = get_types_from_idl(definition)
        else:
            types = get_types_from_msg(definition, msgtype)
        fields = types[msgtype][1]
    except Exception:  # the parser raises errors of many types
        return None
    return bool(fields) and fields[0][1][1] == 'std_msgs/msg/Header'
