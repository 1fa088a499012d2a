"""The participants of Fast DDS in this process, if there are several in one domain."""

import ctypes

from rclpy.node import Node

from puretf_tools.cli import fast_dds

_LOOKUP_ALL = '_ZNK8eprosima7fastdds3dds24DomainParticipantFactory19lookup_participantsEj'


def destroy_newest(node: Node) -> None:
    """
    Destroy the node that was created last, as `cli.fast_dds.destroy` does with the only one.

    That would detach the discovery listener of the first node, here one of the test: it would
    discover nothing any more.
    """
    if (library := fast_dds.loaded()) is None:  # another middleware
        node.destroy_node()
        return
    get_factory, lookup_all = library[fast_dds._GET_FACTORY], library[_LOOKUP_ALL]
    get_factory.restype = ctypes.c_void_p
    # The function returns a std::vector of pointers: its begin, its end and the end of its memory.
    vector = (ctypes.c_void_p * 3)()
    lookup_all(vector, ctypes.c_void_p(get_factory()),
               ctypes.c_uint32(node.context.get_domain_id()))
    newest = ctypes.c_void_p.from_address((vector[1] or 0) - ctypes.sizeof(ctypes.c_void_p))
    library[fast_dds._SET_LISTENER](newest, None, ctypes.c_int64(fast_dds._TIMEOUT))
    node.destroy_node()
