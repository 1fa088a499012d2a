"""
Start and destroy nodes without the hangs that errors in Fast DDS can cause.

This uses functions of Fast DDS that ROS does not expose; test/ros/test_fast_dds.py checks them.
"""

from collections.abc import Iterator
from contextlib import suppress
import ctypes
import os
from pathlib import Path
import re
import stat
import time
from typing import Optional

from rclpy.node import Node

#: Of Jazzy and of Kilted.
_LIBRARIES = 'libfastrtps.so.2.14', 'libfastdds.so.3.2'
_DDS = '_ZN8eprosima7fastdds3dds'
_GET_FACTORY = f'{_DDS}24DomainParticipantFactory12get_instanceEv'
_LOOKUP = '_ZNK8eprosima7fastdds3dds24DomainParticipantFactory18lookup_participantEj'
_SET_LISTENER = (f'{_DDS}17DomainParticipant12set_listenerEPNS1_25DomainParticipantListenerE'
                 'NSt6chrono8durationIlSt5ratioILl1ELl1EEEE')
_TIMEOUT = 1  # s
#: A file that is unfinished at this age (s) is left over: Fast DDS needs milliseconds.
_LEFT_OVER = 5.0


def remove_unfinished_ports(directory: Path = Path('/dev/shm')) -> Iterator[str]:
    """
    Remove the unfinished files that killed processes have left; yield a sentence for each.

    If the file of a port is empty, or its first number says that it is being created, Fast DDS
    waits for ever while its caller holds the GIL, so that no signal ends the process. (Files with
    names in `_el` are always empty, and in use.)
    """
    for path in sorted(directory.glob('fast*_port*')):
        if not re.fullmatch(r'fast(rtps|dds)_port\d+', path.name):
            continue
        try:
            status = path.lstat()
            if (not stat.S_ISREG(status.st_mode) or time.time() - status.st_mtime < _LEFT_OVER
                    or not os.access(path, os.R_OK)  # Fast DDS cannot read it either
                    or int.from_bytes(path.read_bytes()[:4], 'little') >= 2):  # 2: finished
                continue
            path.unlink()
        except FileNotFoundError:
            pass  # another command has removed it
        except OSError as error:
            yield (f'cannot remove {path} ({error.strerror}): a process that was killed has left '
                   'it unfinished, and ROS programs that use this port hang; remove it as its '
                   f'owner: rm {path}')
        else:
            yield (f'removed {path}: a process that was killed has left it unfinished, and ROS '
                   'programs that use this port would hang')


def destroy(node: Node) -> None:
    """Destroy the last node of this process in its domain; see `detach_discovery_listener`."""
    with suppress(RuntimeError):  # the context is shut down, and its domain no longer known
        detach_discovery_listener(node.context.get_domain_id())
    node.destroy_node()


def loaded() -> Optional[ctypes.CDLL]:
    """Return the library of Fast DDS in this process; None: another version, or no Fast DDS."""
    for name in _LIBRARIES:
        with suppress(OSError):
            return ctypes.CDLL(name, mode=os.RTLD_NOLOAD | os.RTLD_LAZY)
    return None


def detach_discovery_listener(domain_id: int) -> bool:
    """
    Detach the discovery listener before rmw_fastrtps does; return False without a known Fast DDS.

    rmw_fastrtps detaches it with an infinite timeout. Fast DDS adds this to now(), and the sum
    overflows. If a callback is pending, because another participant comes or goes, it then
    busy-waits for ever while it holds the lock that the callback needs. Here the timeout is 1 s.
    """
    if (library := loaded()) is None:
        return False
    try:
        get_factory, lookup, set_listener = (
            library[name] for name in (_GET_FACTORY, _LOOKUP, _SET_LISTENER))
    except AttributeError:
        return False
    get_factory.restype = lookup.restype = ctypes.c_void_p
    lookup.argtypes = ctypes.c_void_p, ctypes.c_uint32
    set_listener.argtypes = ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64
    participant = lookup(get_factory(), domain_id)
    if not participant:
        return False
    set_listener(participant, None, _TIMEOUT)
    return True
