"""The subpackages, and which of them may import which, as CONTRIBUTING says."""

import os
import subprocess
import sys

from environment import ROOT, WITHOUT_ROS
from imports import imported, modules, of_ros, reached

#: For each part of the package the parts of it that may be imported. The longest name counts.
MAY_IMPORT = {
    'dummy_arm.dummy_arm': ['dummy_arm.arm', 'dummy_arm.cli', 'dummy_arm.tf'],
    'dummy_arm.arm': ['dummy_arm.tf'],
    'dummy_arm.doctor': ['dummy_arm.doctor', 'dummy_arm.inspection', 'dummy_arm.tf'],
    'dummy_arm.cli': ['dummy_arm.cli', 'dummy_arm.tf'],
    'dummy_arm.grading': ['dummy_arm.cli', 'dummy_arm.grading', 'dummy_arm.inspection',
                          'dummy_arm.tf'],
    'dummy_arm.inspection': ['dummy_arm.inspection', 'dummy_arm.tf'],
    'dummy_arm.robot': ['dummy_arm.inspection', 'dummy_arm.robot', 'dummy_arm.tf'],
    'dummy_arm.tools': ['dummy_arm.arm', 'dummy_arm.cli', 'dummy_arm.doctor',
                        'dummy_arm.grading', 'dummy_arm.inspection', 'dummy_arm.robot',
                        'dummy_arm.tf', 'dummy_arm.view'],
    'dummy_arm.view': ['dummy_arm.cli', 'dummy_arm.doctor', 'dummy_arm.inspection',
                       'dummy_arm.robot', 'dummy_arm.tf', 'dummy_arm.view'],
    'dummy_arm.tf': ['dummy_arm.tf'],
    'dummy_arm.tf._core': ['dummy_arm.tf._core', 'dummy_arm.tf.exceptions',
                           'dummy_arm.tf.transform'],
    'dummy_arm.tf._wire': ['dummy_arm.tf._wire', 'dummy_arm.tf._core.pose',
                           'dummy_arm.tf._core.times', 'dummy_arm.tf.exceptions'],
    'dummy_arm.tf._bag': ['dummy_arm.tf._bag', 'dummy_arm.tf._core', 'dummy_arm.tf._wire'],
    'dummy_arm.tf._tf2_msgs': ['dummy_arm.tf._core', 'dummy_arm.tf._tf2_msgs',
                               'dummy_arm.tf._wire'],
    'dummy_arm.tf._ros': ['dummy_arm.tf._core', 'dummy_arm.tf._ros', 'dummy_arm.tf._tf2_msgs',
                          'dummy_arm.tf._wire', 'dummy_arm.tf.exceptions',
                          'dummy_arm.tf.transform']}
NO_ROS = 'dummy_arm.tf._core', 'dummy_arm.tf._wire', 'dummy_arm.tf._bag', 'dummy_arm.doctor'


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
    if is_private(other) and not lies_in(name, 'dummy_arm.tf'):
        return False
    return any(lies_in(other, part) for part in MAY_IMPORT[part_of(name)])


def own(names):
    """Return those of some modules that are in this package, without the package itself."""
    return {name for name in names if name in modules() and name != 'dummy_arm'}


NAMES = sorted(own(modules()))


def test_a_module_imports_only_what_it_may():
    """This holds for imports in functions, too."""
    assert not [(name, other) for name in NAMES for other in own(imported(modules()[name]))
                if not may_import(name, other)]


def test_what_may_not_be_imported_is_noticed():
    """The rules accept what is allowed, and nothing else."""
    assert not may_import('dummy_arm.doctor.report', 'dummy_arm.cli.bag_options')
    assert not may_import('dummy_arm.grading.arm_check', 'dummy_arm.doctor.checks')
    assert may_import('dummy_arm.tf.buffer', 'dummy_arm.tf._core.engine')
    assert may_import('dummy_arm.tf._wire.cdr', 'dummy_arm.tf._core.pose')
    assert not may_import('dummy_arm.tf.bag', 'dummy_arm.cli.signals')
    assert not may_import('dummy_arm.tools.view_frames', 'dummy_arm.tf._core.texts')
    assert not may_import('dummy_arm.tf._core.engine', 'dummy_arm.tf._wire.message_reader')


def test_no_module_imports_itself_by_way_of_others():
    """This holds for imports in functions, too."""
    assert not [name for name in NAMES if name in reached(modules()[name])]


def test_the_entry_points_import_nothing_but_signals():
    """They import the modules of commands by name, once signals are recorded."""
    assert own(imported(modules()['dummy_arm.cli.entry_points'])) == {'dummy_arm.cli.signals'}
    assert not own(imported(modules()['dummy_arm.cli.signals']))


def test_what_every_command_starts_with_is_light():
    """It does not import numpy, which takes longer than all the rest."""
    for name in 'cli.entry_points', 'cli.parser', 'tf.formatting':
        assert 'numpy' not in reached(modules()[f'dummy_arm.{name}'], is_late=False)


def test_grading_starts_without_numpy():
    """A supervisor runs for each hand-in; only observers and readers of drawings need numpy."""
    code = ('import dummy_arm.grading.supervisor, sys; from dummy_arm.grading import grade; '
            'sys.exit(bool({"numpy", "rclpy"} & {*sys.modules}))')
    subprocess.run([sys.executable, '-c', code], check=True, timeout=60)


def test_what_reads_bags_reaches_no_ros():
    """No chain of imports leads to ROS, not even by imports in functions."""
    assert not {name: found for name in NAMES if name.startswith(NO_ROS)
                and (found := of_ros(reached(modules()[name])))}


WITHOUT = [name for name in NAMES if not of_ros(reached(modules()[name], is_late=False))]


def test_modules_that_need_no_ros():
    """Those that users of bags need are among them."""
    assert {'dummy_arm.arm', 'dummy_arm.tf', 'dummy_arm.tf.bag', 'dummy_arm.tf.transform_buffer',
            'dummy_arm.doctor', 'dummy_arm.tf.exceptions', 'dummy_arm.tf.rotations',
            'dummy_arm.tf.formatting', 'dummy_arm.tf.transform', 'dummy_arm.tf.transform_table',
            'dummy_arm.tools.tf2_echo', 'dummy_arm.tools.tf_doctor',
            'dummy_arm.tools.tf_trajectory', 'dummy_arm.tools.view_frames',
            'dummy_arm.tools.web_view', 'dummy_arm.view.feed'} <= {*WITHOUT}
    assert 'dummy_arm.tf.buffer' not in WITHOUT


def test_modules_that_reach_no_ros_can_be_imported_without_it():
    """Neither rclpy nor any message package can be imported there."""
    # These import viser, rosbags or mcap, which need not be installed.
    others = 'dummy_arm.view.', 'dummy_arm.tf._bag.whole_files', 'dummy_arm.tf._bag.mcap_stream'
    names = [name for name in WITHOUT if not name.startswith(others)]
    code = ''.join(f'import {name}\n' for name in names)
    subprocess.run([sys.executable, '-c', WITHOUT_ROS + code], check=True, env=os.environ,
                   timeout=60)


def test_examples_use_public_names_only():
    """They import `dummy_arm.tf` and its modules without an underscore."""
    for path in (ROOT / 'docs' / 'examples').glob('*.py'):
        used = {name.partition(':')[0] for name in imported(path) if name.startswith('dummy_arm')}
        assert used, path
        assert not [name for name in used
                    if not lies_in(name, 'dummy_arm.tf') or is_private(name)], path


def test_no_module_has_a_name_of_the_standard_library():
    """A program beside it would import it in place of the standard module."""
    assert not {modules()[name].stem for name in NAMES} & sys.stdlib_module_names
