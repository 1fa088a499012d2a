"""
What this package uses of Fast DDS that is not public to users of ROS: its participant.

test/test_fast_dds.py states what this relies on.
"""

import ctypes
import os

from rclpy.logging import get_logger
from rclpy.node import Node

_LIBRARY = 'libfastrtps.so.2.14'
_DDS = '_ZN8eprosima7fastdds3dds'
_GET_FACTORY = f'{_DDS}24DomainParticipantFactory12get_instanceEv'
_LOOKUP = '_ZNK8eprosima7fastdds3dds24DomainParticipantFactory18lookup_participantEj'
_SET_LISTENER = (f'{_DDS}17DomainParticipant12set_listenerEPNS1_25DomainParticipantListenerE'
                 'NSt6chrono8durationIlSt5ratioILl1ELl1EEEE')
_LIMIT = 1  # s


def destroy(node: Node) -> None:
    """Destroy the last node of this process in its domain, though others come or go just then."""
    detach_discovery_listener(node.context.get_domain_id())
    node.destroy_node()


def detach_discovery_listener(domain_id: int) -> bool:
    """
    Detach the listener by which a participant reports that others come and go.

    rmw_fastrtps does so when the last node is destroyed, with an infinite timeout. Fast DDS 2.14
    adds that to now(), which overflows; if others come or go just then, as those that the same
    Ctrl-C has ended, it busy-waits for ever, and holds the lock that the pending callback needs
    (`DomainParticipant::set_listener`). With a timeout of a second it waits as it should.

    :returns: whether there was a participant of that Fast DDS; where there is none, as with
        another middleware or version, nothing is done.
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
    set_listener(participant, None, _LIMIT)
    return True


def _does_not_apply(why: str) -> bool:
    get_logger('dummy_arm').debug(f'the discovery listener of Fast DDS is not detached: {why}')
    return False
