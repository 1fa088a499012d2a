"""Messages that arrive as with rmw_cyclonedds_cpp, and a stand-in for the library libddsc."""

import ctypes
from ctypes import c_char, c_int32, c_uint64, c_void_p, CFUNCTYPE
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.utilities import get_rmw_implementation_identifier

from puretf._ros import cyclone_dds, rclpy_private


class Endpoint(ctypes.Structure):
    """The struct dds_builtintopic_endpoint_t of Cyclone DDS 0.10."""

    _fields_ = [('key', c_char * 16), ('participant_key', c_char * 16),
                ('participant_instance_handle', c_uint64), ('topic_name', c_void_p),
                ('type_name', c_void_p), ('qos', c_void_p)]


class Library:
    """A stand-in for libddsc, with functions of C that are called by pointers."""

    def __init__(self) -> None:
        """Create a library that knows no publisher."""
        #: By handle: the gid of the publisher.
        self.gids: dict[int, bytes] = {}
        #: The calls of the first function: the reader and the handle.
        self.calls: list[tuple[int, int]] = []
        #: The structs that are not freed, by their addresses.
        self.structs: dict[int, Endpoint] = {}
        self.dds_get_matched_publication_data = CFUNCTYPE(c_void_p, c_int32, c_uint64)(self._get)
        self.dds_builtintopic_free_endpoint = CFUNCTYPE(None, c_void_p)(self._free)

    def _get(self, reader: int, handle: int) -> int:
        self.calls.append((reader, handle))
        if handle not in self.gids:
            return 0
        struct = Endpoint()
        ctypes.memmove(ctypes.addressof(struct), self.gids[handle], 16)
        self.structs[ctypes.addressof(struct)] = struct
        return ctypes.addressof(struct)

    def _free(self, address: int) -> None:
        del self.structs[address]


def install(library: object, patch: pytest.MonkeyPatch) -> None:
    """Let ctypes load a stand-in for libddsc; None: it cannot be loaded."""
    def load(name: str, mode: int) -> object:
        if library is None:
            raise OSError(f'{name}: cannot open shared object file')
        return library

    patch.setattr(cyclone_dds, 'ctypes', SimpleNamespace(CDLL=load, string_at=ctypes.string_at))


@pytest.fixture
def handles(monkeypatch: pytest.MonkeyPatch) -> dict[bytes, int]:
    """
    Let each message arrive with a handle in place of its gid, as with rmw_cyclonedds_cpp 2.2.

    The package takes the middleware for rmw_cyclonedds_cpp whose library cannot be loaded. The
    fixture is a dict from each gid that has arrived to its handle.
    """
    if 'fastrtps' not in get_rmw_implementation_identifier():
        pytest.skip('the gids of another middleware may be those of no publisher')
    handles: dict[bytes, int] = {}
    take = rclpy_private.rcl_take()

    def take_with_handle(handle: int, message: Any, info: Any, allocation: None) -> Any:
        code = take(handle, message, info, allocation)
        if not code:
            number = handles.setdefault(bytes(info.gid), 0x782149b8e49fc600 + len(handles))
            info.gid[:] = number.to_bytes(8, 'little') + bytes(8)
        return code

    install(None, monkeypatch)
    monkeypatch.setattr(rclpy_private, 'rcl_take', lambda: take_with_handle)
    monkeypatch.setattr(
        rclpy_private, 'get_rmw_implementation_identifier', lambda: 'rmw_cyclonedds_cpp')
    return handles


@pytest.fixture
def libddsc(handles: dict[bytes, int], monkeypatch: pytest.MonkeyPatch) -> Library:
    """As `handles`, with a library that knows each publisher from which a message has arrived."""
    library = Library()
    install(library, monkeypatch)

    class Gids(dict[int, bytes]):
        """The gids of all handles."""

        def __contains__(self, handle: object) -> bool:
            return handle in handles.values()

        def __getitem__(self, handle: int) -> bytes:
            return next(gid for gid, each in handles.items() if each == handle)

    library.gids = Gids()
    return library
