"""
Start and destroy nodes without the hangs that errors in Fast DDS 2.14 can cause.

This module calls functions of Fast DDS that ROS does not expose, and knows the names of its files.
test/ros/test_fast_dds.py tests the behaviour on which this module relies.
"""

from collections.abc import Iterator
from contextlib import suppress
import ctypes
import os
from pathlib import Path
import re
import stat
import time

from rclpy.logging import get_logger
from rclpy.node import Node

_LIBRARY = 'libfastrtps.so.2.14'
_DDS = '_ZN8eprosima7fastdds3dds'
_GET_FACTORY = f'{_DDS}24DomainParticipantFactory12get_instanceEv'
_LOOKUP = '_ZNK8eprosima7fastdds3dds24DomainParticipantFactory18lookup_participantEj'
_SET_LISTENER = (f'{_DDS}17DomainParticipant12set_listenerEPNS1_25DomainParticipantListenerE'
                 'NSt6chrono8durationIlSt5ratioILl1ELl1EEEE')
_TIMEOUT = 1  # s
#: A file is left over if it is empty and was not changed for this time (s). Fast DDS sets the size
#: of a new file within milliseconds.
_LEFT_OVER = 5.0


def remove_empty_ports(directory: Path = Path('/dev/shm')) -> Iterator[str]:
    """
    Remove the empty files that processes killed by SIGKILL have left in shared memory.

    If the file of a port that Fast DDS opens is empty, Fast DDS busy-waits for ever while it holds
    the GIL, so that neither Ctrl-C nor SIGTERM ends the process. The files whose names end in
    `_el` are always empty, and in use.

    :param directory: the directory of the files; it need not exist.
    :returns: a sentence for each such file: it was removed, or cannot be removed.
    """
    for path in sorted(directory.glob('fastrtps_port*')):
        if not re.fullmatch(r'fastrtps_port\d+', path.name):
            continue
        try:
            status = path.lstat()
            if (not stat.S_ISREG(status.st_mode) or status.st_size
                    or time.time() - status.st_mtime < _LEFT_OVER):
                continue
            path.unlink()
        except FileNotFoundError:  # another command has removed it
            continue
        except OSError as error:
            yield (f'cannot remove {path} ({error.strerror}): it is empty, left over from a '
                   'process that was killed, and ROS programs that use this port hang; remove it '
                   f'as its owner: rm {path}')
            continue
        yield (f'removed {path}: it was empty, left over from a process that was killed, and ROS '
               'programs that use this port would hang')


def destroy(node: Node) -> None:
    """
    Destroy a node without the hang that `detach_discovery_listener` describes.

    If the context is shut down, its domain is not known any more, and the hang is possible.

    :param node: the node, which must be the last node of this process in its ROS domain.
    """
    with suppress(RuntimeError):  # of rcl: the context is shut down
        detach_discovery_listener(node.context.get_domain_id())
    node.destroy_node()


def detach_discovery_listener(domain_id: int) -> bool:
    """
    Detach the discovery listener from the Fast DDS participant of this process.

    When the last node is destroyed, rmw_fastrtps calls `DomainParticipant::set_listener` to detach
    the listener. The timeout of this call is infinite. Fast DDS 2.14 adds the timeout to now(),
    and the sum overflows. If a callback of the listener is pending at this moment, Fast DDS
    busy-waits for ever while it holds the lock that the callback needs. A callback is pending if
    another participant has just been found or lost, for example when one Ctrl-C ends several
    nodes.

    This function detaches the listener before rmw_fastrtps does, and uses a timeout of one second.
    With this timeout, the sum does not overflow, and Fast DDS waits as intended.

    :param domain_id: the ROS domain of the participant.
    :returns: True if the listener was detached; False if this process has no participant of Fast
        DDS 2.14 in the domain.
    """
    try:
        library = ctypes.CDLL(_LIBRARY, mode=os.RTLD_NOLOAD | os.RTLD_LAZY)
        get_factory, lookup, set_listener = (
            library[name] for name in (_GET_FACTORY, _LOOKUP, _SET_LISTENER))
    except (OSError, AttributeError) as error:
        return _does_not_apply(str(error))
    get_factory.restype = lookup.restype = ctypes.c_void_p
    lookup.argtypes = ctypes.c_void_p, ctypes.c_uint32
    set_listener.argtypes = ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64
    participant = lookup(get_factory(), domain_id)
    if not participant:
        return _does_not_apply(f'no participant in the domain {domain_id}')
    set_listener(participant, None, _TIMEOUT)
    return True


def _does_not_apply(reason: str) -> bool:
    get_logger('dummy_arm').debug(f'the discovery listener of Fast DDS is not detached: {reason}')
    return False
