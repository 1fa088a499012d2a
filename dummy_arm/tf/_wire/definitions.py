"""What bags record of the messages on a topic: the definition of their type, and the QoS."""

from functools import lru_cache
import re
from typing import Optional


def durabilities(profiles: str) -> list[str]:
    """Return the durability in each of the QoS profiles that rosbag2 has recorded as YAML."""
    from rosbags.rosbag2.metadata import parse_qos
    try:
        return [profile.durability.name for profile in parse_qos(profiles)]
    except Exception:  # a damaged or incomplete text raises errors of many types
        return []


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
