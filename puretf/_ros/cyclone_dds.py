"""
The gids of publishers with rmw_cyclonedds_cpp 2.2, which reports handles with messages.

Within a process, Cyclone DDS identifies each publisher by a handle. This module asks Cyclone DDS
for the gids that belong to the handles, with functions that ROS does not expose.
"""

from collections.abc import Callable
import ctypes
from ctypes import c_int32, c_uint64, c_void_p
from functools import lru_cache
import os
import sys
from typing import Optional

IDENTIFIER = 'rmw_cyclonedds_cpp'
_LIBRARY = 'libddsc.so.0'
#: The number of bytes of a gid, and of a handle. In a message's info, zeros follow the handle.
_GID_SIZE, _HANDLE_SIZE = 16, 8


def gid_translator(data: int, most: int = 10_000) -> Optional[Callable[[str], str]]:
    """
    Return a function that converts the handle in a message's info to a gid, both in hex.

    `data` is the address of the struct CddsSubscription. If the publisher has ended before the
    first call, the function returns its argument. It keeps at most `most` gids. None: Cyclone DDS
    or its functions are missing.
    """
    try:
        library = ctypes.CDLL(_LIBRARY, mode=os.RTLD_NOLOAD | os.RTLD_LAZY)
        get_publisher = library.dds_get_matched_publication_data
        free = library.dds_builtintopic_free_endpoint
    except (OSError, AttributeError):
        return None
    get_publisher.argtypes, get_publisher.restype = (c_int32, c_uint64), c_void_p
    free.argtypes, free.restype = (c_void_p,), None
    # The struct begins with the handle of the reader.
    reader = c_int32.from_address(data).value

    @lru_cache(most)
    def gid_of(reported: str) -> str:
        handle = int.from_bytes(bytes.fromhex(reported)[:_HANDLE_SIZE], sys.byteorder)
        if not (publisher := get_publisher(reader, handle)):
            return reported
        # The struct dds_builtintopic_endpoint_t begins with the gid.
        gid = ctypes.string_at(publisher, _GID_SIZE).hex()
        free(publisher)
        return gid

    return gid_of
