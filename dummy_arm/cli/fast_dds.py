"""
Destroy a node without the hang that an error in Fast DDS 2.14 can cause.

This module calls functions of Fast DDS that ROS does not expose. test/ros/test_fast_dds.py tests
the behaviour of these functions.
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
_TIMEOUT = 1  # s


def destroy(node: Node) -> None:
    """
    Destroy a node without the hang that `detach_discovery_listener` describes.

    :param node: the node, which must be the last node of this process in its ROS domain.
    """
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
