"""The gids of publishers with rmw_cyclonedds_cpp, with a stand-in for the library libddsc."""

import ctypes
from types import SimpleNamespace

from cyclone import install, Library
import pytest

from puretf._ros.cyclone_dds import gid_translator, IDENTIFIER

READER = ctypes.c_int32(1234)
DATA = ctypes.addressof(READER)
#: Of Cyclone DDS: handles of two writers, what arrives with their messages, and their GUIDs.
FIRST, SECOND = 0x782149b8e49fc6e5, 0xfc1f2239a430205d
ARRIVED = {FIRST: 'e5c69fe4b8492178' + 16 * '0', SECOND: '5d2030a439221ffc' + 16 * '0'}
GIDS = {FIRST: '011013e3dc9535d452034e5200000203', SECOND: '0110c5d27f3efcfbd3bbadf800000203'}


@pytest.fixture
def library(monkeypatch):
    """A library that knows two publishers."""
    library = Library()
    library.gids = {handle: bytes.fromhex(gid) for handle, gid in GIDS.items()}
    install(library, monkeypatch)
    return library


def translator(**kwargs):
    """Return the function for the messages of the subscription."""
    gid_of = gid_translator(DATA, **kwargs)
    assert gid_of is not None
    return gid_of


def test_each_publisher_is_asked_for_once(library):
    """The gid is the beginning of the struct, which is then freed."""
    gid_of = translator()
    assert [gid_of(ARRIVED[handle]) for handle in (FIRST, SECOND, FIRST, SECOND)] == [
        GIDS[FIRST], GIDS[SECOND]] * 2
    assert library.calls == [(1234, FIRST), (1234, SECOND)]
    assert not library.structs


def test_a_publisher_that_has_ended_keeps_its_gid(library):
    """But if it had ended before it was asked for, what has arrived is returned."""
    gid_of = translator()
    assert gid_of(ARRIVED[FIRST]) == GIDS[FIRST]
    library.gids.clear()
    assert gid_of(ARRIVED[FIRST]) == GIDS[FIRST]
    assert gid_of(ARRIVED[SECOND]) == ARRIVED[SECOND]


def test_the_number_of_gids_is_bounded(library):
    """The oldest gid is forgotten; its publisher is asked for again."""
    gid_of = translator(most=1)
    for handle in FIRST, SECOND, SECOND, FIRST:
        assert gid_of(ARRIVED[handle]) == GIDS[handle]
    assert [handle for _, handle in library.calls] == [FIRST, SECOND, FIRST]
    assert not library.structs


@pytest.mark.parametrize('lacking', [
    None, SimpleNamespace(), SimpleNamespace(dds_get_matched_publication_data=print),
    SimpleNamespace(dds_builtintopic_free_endpoint=print)])
def test_without_the_library_or_a_function_nobody_can_be_asked(monkeypatch, lacking):
    """There is no translator then."""
    install(lacking, monkeypatch)
    assert gid_translator(DATA) is None


def test_the_identifier_is_that_of_the_middleware():
    """This is what `rclpy.utilities.get_rmw_implementation_identifier` returns."""
    assert IDENTIFIER == 'rmw_cyclonedds_cpp'
