"""
Tests of the private names of other libraries: which file uses them, and how Python's behave.

Those of rclpy, viser, Fast DDS and Cyclone DDS are in test_rclpy_private.py,
test_viser_private.py, test_fast_dds.py and test_cyclone_dds.py.
"""

from argparse import ArgumentParser
import ast
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
import re
import sys
from threading import RLock
from typing import Any

from environment import ROOT
from imports import modules, PACKAGES
import pytest

#: The slots of generated messages: geometry_msgs, std_msgs, builtin_interfaces.
SLOTS = {'_child_frame_id', '_frame_id', '_nanosec', '_sec', '_stamp', '_transform',
         '_translation', '_w', '_x', '_y', '_z'}
#: The private names that are used, by the file that uses them: one file for each library.
PRIVATE = {
    'puretf_tools/cli/parser.py': {'_option_string_actions'},  # argparse
    **({'puretf/_bag/mcap_file.py': {
        'mcap.stream_reader.MAGIC_SIZE', 'mcap.stream_reader.breakup_chunk'}} if find_spec('mcap')
       else {}),
    'puretf/_core/engine.py': {'_is_owned'},  # threading
    'puretf/_ros/rclpy_private.py': {
        '_parameter_overrides', 'rclpy.impl.implementation_singleton'},
    'puretf/_ros/transform_stamped.py': SLOTS,
    'puretf_tools/view/viser_private.py': {
        '_gui_input_handle_from_uuid', '_handle_incoming_message', '_impl', '_live_connections',
        '_queue_scene_message', '_websock_connection', '_websock_server', 'viser._messages'}}
#: Our packages, the standard library, and a library that does not list all public modules.
NOT_SEARCHED = {*PACKAGES, *sys.stdlib_module_names, 'matplotlib'}
#: Names with an underscore that the documentation of Python has.
PUBLIC = {'_current_frames', '_thread', '_asdict', '_fields', '_replace', '_make', '_exit'}


def is_private(name):
    """Return True if a name begins with exactly one underscore."""
    return re.match('_[^_]', name) is not None


def not_exported(tree):
    """Yield the names that a module imports, but their library does not export by `__all__`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and (
                node.module.partition('.')[0] not in NOT_SEARCHED):
            with suppress(ImportError):
                yield from (f'{node.module}.{alias.name}' for alias in node.names
                            if not is_exported(node.module, alias.name))


def is_exported(module, name):
    """Return False if a module, or the package above a module without `__all__`, leaves it out."""
    names = getattr(import_module(module), '__all__', None)
    package, _, last = module.rpartition('.')
    return (name in names if names is not None else not package or
            last in getattr(import_module(package), '__all__', [last]))


def own_names(tree):
    """Yield the names that a module defines itself."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) and (
                isinstance(node.value, ast.Name) and node.value.id == 'self'):
            yield node.attr


def used_names(tree):
    """Yield the private attributes and modules that a module uses."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and is_private(node.attr):
            yield node.attr
        modules = ([alias.name for alias in node.names] if isinstance(node, ast.Import) else
                   [node.module or ''] if isinstance(node, ast.ImportFrom) else [])
        for module in modules:
            parts = module.split('.')
            if parts[0] not in PACKAGES and (
                    any(map(is_private, parts)) or parts[:2] == ['rclpy', 'impl']):
                yield module


def test_private_names_are_used_by_one_file_for_each_library():
    """The listed names are used, and no others."""
    trees = {str(path.relative_to(ROOT)): ast.parse(path.read_text())
             for path in modules().values()}
    own = PUBLIC.union(*map(own_names, trees.values())) - SLOTS
    used = {path: ({*used_names(tree)} - own) | {*not_exported(tree)}
            for path, tree in trees.items()}
    assert {path: names for path, names in used.items() if names or path in PRIVATE} == PRIVATE


@pytest.mark.parametrize(('name', 'file'), [
    ('eprosima', 'fast_dds.py'), ('.dds_', 'cyclone_dds.py')])
def test_a_middleware_is_used_by_one_file(name, file):
    """The mangled symbols of Fast DDS, and the functions of Cyclone DDS, are in no other file."""
    assert [path.name for path in modules().values() if name in path.read_text()] == [file]


def test_a_lock_knows_whether_this_thread_holds_it():
    """`RLock._is_owned` distinguishes a nested call from a call in another thread."""
    lock: Any = RLock()
    assert not lock._is_owned()
    with lock, ThreadPoolExecutor(1) as other:
        with lock:
            assert lock._is_owned()
        assert lock._is_owned()
        assert not other.submit(lock._is_owned).result()
    assert not lock._is_owned()


def test_a_parser_knows_its_options_and_what_is_a_negative_number():
    """ArgumentParser has `_option_string_actions`, and uses `_negative_number_matcher`."""
    parser = ArgumentParser()
    parser.add_argument('-r', '--rate')
    parser.add_argument('x', type=float)
    assert {'-r', '--rate'} <= {*parser._option_string_actions}
    parser._negative_number_matcher = re.compile('-1e5')
    assert parser.parse_args(['-1e5']).x == -1e5
