"""
Find out the gids of publishers with rmw_cyclonedds_cpp.

rmw_cyclonedds_cpp 2.2 does not report the gid of the publisher with a message. In its place, it
reports the number under which Cyclone DDS knows the publisher in this process. This module asks
Cyclone DDS for the gid, by functions that ROS does not expose. test/ros/test_cyclone_dds.py tests
this module with a stand-in for the library.
"""

from collections.abc import Callable
import ctypes
from ctypes import c_int32, c_uint64, c_void_p
import os
import sys
from typing import Optional

#: The identifier of the middleware to which this module applies.
IDENTIFIER = 'rmw_cyclonedds_cpp'
_LIBRARY = 'libddsc.so.0'
#: The number of bytes of a gid, and of a handle. In a message's info, zeros follow the handle.
_GID_SIZE, _HANDLE_SIZE = 16, 8
#: The largest number of gids that are kept for a subscription.
_MOST = 10_000


def gid_translator(data: int) -> Optional[Callable[[str], str]]:
    """
    Create the function that finds out the gids of the publishers of a subscription's messages.

    :param data: the address of the struct CddsSubscription of the subscription.
    :returns: a function from what is reported with a message to the gid of the publisher, both in
        hex. If the publisher has ended before the first call with its handle, the function returns
        its argument, which is not the gid of any publisher. None: Cyclone DDS cannot be asked.
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
    gids: dict[str, str] = {}

    def gid_of(reported: str) -> str:
        """
        Return the gid of a publisher.

        :param reported: what is reported with a message, in hex.
        :returns: the gid in hex; `reported` if the publisher has ended.
        """
        gid = gids.get(reported)
        if gid is None:
            handle = int.from_bytes(bytes.fromhex(reported)[:_HANDLE_SIZE], sys.byteorder)
            if not (publisher := get_publisher(reader, handle)):
                return reported
            # The struct dds_builtintopic_endpoint_t begins with the gid.
            gid = gids[reported] = ctypes.string_at(publisher, _GID_SIZE).hex()
            free(publisher)
            if len(gids) > _MOST:
                del gids[next(iter(gids))]
        return gid

    return gid_of
