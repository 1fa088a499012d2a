"""The participant by which Fast DDS has this process talk to others."""

import ctypes
import os

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
    hear_no_more(node.context.get_domain_id())
    node.destroy_node()


def hear_no_more(domain_id: int) -> None:
    """
    Have the participant tell ROS no more of others that come and go, before its node is destroyed.

    The middleware does so then, with the longest limit of time that there is. Added to the time
    of now that overflows; and if Fast DDS tells of others just then, as of those that the same
    Ctrl-C has ended, it spins for ever, and holds the lock that the telling needs to end
    (`DomainParticipant::set_listener` of 2.14). With a limit of a second it waits as it should.
    Where there is another middleware, or another version, nothing is done.
    """
    try:
        library = ctypes.CDLL(_LIBRARY, mode=os.RTLD_NOLOAD | os.RTLD_LAZY)
        get_factory, lookup, set_listener = (
            library[name] for name in (_GET_FACTORY, _LOOKUP, _SET_LISTENER))
    except (OSError, AttributeError):
        return
    get_factory.restype = lookup.restype = ctypes.c_void_p
    lookup.argtypes = ctypes.c_void_p, ctypes.c_uint32
    set_listener.argtypes = ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64
    if participant := lookup(get_factory(), domain_id):
        set_listener(participant, None, _LIMIT)
