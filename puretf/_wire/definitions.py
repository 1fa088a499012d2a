"""The definitions of types that bags record."""

from functools import lru_cache
import re
from typing import Optional


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
