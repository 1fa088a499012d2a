"""The subpackages, and which of them may import which, as CONTRIBUTING says."""

import os
import subprocess
import sys

from environment import ROOT, WITHOUT_ROS
from imports import imported, modules, of_ros, PACKAGES, reached

#: For each part of the packages the parts that it may import. The longest name counts.
MAY_IMPORT = {
    'puretf': ['puretf'],
    'puretf._text': ['puretf._text'],
    'puretf._causes': ['puretf._causes', 'puretf._text', 'puretf.exceptions'],
    'puretf._core': ['puretf._core', 'puretf._causes', 'puretf._text', 'puretf.exceptions',
                     'puretf.transform'],
    'puretf._wire': ['puretf._wire', 'puretf._core.pose', 'puretf._core.times', 'puretf._text',
                     'puretf.exceptions'],
    'puretf._bag': ['puretf._bag', 'puretf._core', 'puretf._text', 'puretf._wire'],
    'puretf._tf2_msgs': ['puretf._core', 'puretf._text', 'puretf._tf2_msgs', 'puretf._wire'],
    'puretf._ros': ['puretf._causes', 'puretf._core', 'puretf._ros', 'puretf._text',
                    'puretf._tf2_msgs', 'puretf._wire', 'puretf.exceptions', 'puretf.transform'],
    'puretf_tools': ['puretf_tools.cli'],
    **{f'puretf_tools.{room}': ['puretf', *(f'puretf_tools.{other}' for other in others.split())]
       for room, others in {
           'inspection': 'inspection', 'cli': 'cli', 'source': 'inspection cli',
           'robot': 'robot inspection cli',
           'doctor': 'doctor robot inspection', 'view': 'view doctor robot inspection cli',
           'commands': 'source view doctor robot inspection cli'}.items()},
    'dummy_arm': ['dummy_arm', 'puretf', 'puretf_tools.cli', 'puretf_tools.inspection']}
#: What the tools share with `puretf`, though it is no user's.
SHARED = 'puretf._text', 'puretf._causes'
NO_ROS = (*SHARED, 'puretf._core', 'puretf._wire', 'puretf._bag', 'puretf_tools.doctor')


def lies_in(name, part):
    """Return True if a module is a part of the package, or lies in it."""
    return f'{name}.'.startswith(f'{part}.')


def part_of(name):
    """Return the part of the package in which a module lies."""
    return max((part for part in MAY_IMPORT if lies_in(name, part)), key=len)


def is_private(name):
    """Return True if a module of tf is private."""
    return '._' in name


def may_import(name, other):
    """Return True if a module may import another one of the package."""
    if is_private(other) and not lies_in(name, 'puretf'):
        return other.startswith(SHARED)
    return any(lies_in(other, part) for part in MAY_IMPORT[part_of(name)])


def own(names):
    """Return those of some modules that are in these packages, without the packages themselves."""
    return {name for name in names if name in modules() and name not in PACKAGES}


NAMES = sorted(own(modules()))


def test_a_module_imports_only_what_it_may():
    """This holds for imports in functions, too."""
    assert not [(name, other) for name in NAMES for other in own(imported(modules()[name]))
                if not may_import(name, other)]


def test_what_may_not_be_imported_is_noticed():
    """The rules accept what is allowed, and nothing else."""
    assert not may_import('puretf_tools.doctor.report', 'puretf_tools.cli.bag_options')
    assert may_import('puretf.buffer', 'puretf._core.engine')
    assert may_import('puretf._wire.cdr', 'puretf._core.pose')
    assert not may_import('puretf._core.engine', 'puretf._wire.message_reader')


def test_no_module_imports_itself_by_way_of_others():
    """This holds for imports in functions, too."""
    assert not [name for name in NAMES if name in reached(modules()[name])]


def test_the_entry_points_import_nothing_but_signals():
    """They import the modules of commands by name, once signals are recorded."""
    for package in 'puretf_tools', 'dummy_arm':
        assert own(reached(modules()[f'{package}.entry_points'], is_late=False)) == {
            'puretf_tools.cli.entry_point', 'puretf_tools.cli.signals'}


def test_what_every_command_starts_with_is_light():
    """It does not import numpy, which takes longer than all the rest."""
    for name in 'puretf_tools.cli.entry_point', 'puretf_tools.cli.parser':
        assert 'numpy' not in reached(modules()[name], is_late=False)




def test_what_reads_bags_reaches_no_ros():
    """No chain of imports leads to ROS, not even by imports in functions."""
    assert not {name: found for name in NAMES if name.startswith(NO_ROS)
                and (found := of_ros(reached(modules()[name])))}


WITHOUT = [name for name in NAMES if not of_ros(reached(modules()[name], is_late=False))]


def test_modules_that_need_no_ros():
    """Those that users of bags need are among them."""
    assert {'dummy_arm.arm', 'puretf.bag', 'puretf.transform_buffer',
            'puretf_tools.doctor.observation', 'puretf.exceptions', 'puretf.rotations',
            'puretf.transform', 'puretf.transform_table',
            'puretf_tools.commands.tf2_echo', 'puretf_tools.commands.tf_doctor',
            'puretf_tools.commands.tf_trajectory', 'puretf_tools.commands.view_frames',
            'puretf_tools.commands.web_view', 'puretf_tools.robot.description',
            'puretf_tools.view.feed'} <= {*WITHOUT}
    assert 'puretf.buffer' not in WITHOUT


def test_modules_that_reach_no_ros_can_be_imported_without_it():
    """Neither rclpy nor any message package can be imported there."""
    # These import viser, psutil, or libraries for bags, which need not be installed.
    others = {'viser', 'psutil', 'rosbags', 'apsw', 'lz4', 'mcap'}
    names = [name for name in WITHOUT if not lies_in(name, 'puretf._ros') and others.isdisjoint(
        {each.partition('.')[0] for each in reached(modules()[name], is_late=False)})]
    assert 'dummy_arm.check_arm' in names
    code = ''.join(f'import {name}\n' for name in names)
    subprocess.run([sys.executable, '-c', WITHOUT_ROS + code], check=True, env=os.environ,
                   timeout=60)


def test_examples_use_public_names_only():
    """They import `puretf` and its modules without an underscore."""
    for path in (ROOT / 'docs' / 'examples').glob('*.py'):
        used = {name.partition(':')[0] for name in imported(path) if name.startswith(PACKAGES)}
        assert used, path
        assert not [name for name in used
                    if not lies_in(name, 'puretf') or is_private(name)], path


def test_no_module_has_a_name_of_the_standard_library():
    """A program beside it would import it in place of the standard module."""
    assert not {modules()[name].stem for name in NAMES} & sys.stdlib_module_names
