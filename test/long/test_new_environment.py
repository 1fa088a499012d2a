"""The packages as users install them by pip, in a new environment. It takes 3 min."""

import os
import shutil
import subprocess
import sys

from arms import Arm, hand
import bags
from environment import ROOT
import numpy as np
from processes import OF_THIS_ENVIRONMENT

from puretf_tools.commands import tf_trajectory

#: A program that reads a trajectory by evo, and writes its times and positions.
READ = """if True:
    from evo.tools.file_interface import read_tum_trajectory_file
    import numpy as np
    read = read_tum_trajectory_file('arm.tum')
    assert read.check()[0]
    np.save('read.npy', np.column_stack([read.timestamps, read.positions_xyz]))
"""
#: A program that imports all packages of compat, of which nothing in the clone is used.
IMPORT = """if True:
    from pathlib import Path
    import sensor_msgs_py.point_cloud2, tf2_geometry_msgs, tf2_msgs.msg, tf2_py, tf2_ros
    import tf2_sensor_msgs, tf_transformations
    import puretf
    assert tf2_ros.Buffer is puretf.Buffer
    print(Path(tf2_ros.__file__).parents[1].name)
"""


def test_programs_and_evo(tmp_path):
    """
    The programs for tf2_ros run, `tf_doctor --explain` has its page, and evo reads poses.

    It imports tf2_py to read a bag, and reads the file of tf_trajectory, whose positions differ
    from the analytic motion of the arm by less than 1e-6 m.
    """
    for path in ('docs', 'puretf', 'puretf_tools', 'dummy_arm', 'compat', 'launch', 'resource',
                 'rviz'):
        shutil.copytree(ROOT / path, tmp_path / path,
                        ignore=shutil.ignore_patterns('*.egg-info', 'build'))
    for name in 'README.md', 'package.xml', 'setup.cfg', 'setup.py':
        shutil.copy(ROOT / name, tmp_path)
    directory = tmp_path / 'environment' / 'bin'
    variables = {name: value for name, value in os.environ.items()
                 if name not in OF_THIS_ENVIRONMENT}

    def run(*command, **kwargs):
        result = subprocess.run(command, cwd=tmp_path, text=True, stdout=subprocess.PIPE,
                                stderr=subprocess.STDOUT, check=False,
                                env={**variables, 'HOME': str(tmp_path), **kwargs})
        assert result.returncode == 0, result.stdout
        return result.stdout

    run(sys.executable, '-m', 'venv', directory.parent)
    run(directory / 'pip', 'install', '.[ros]', './compat', HOME=os.environ.get('HOME', ''))
    assert ' passed' in run(
        sys.executable, '-m', 'pytest', '-p', 'no:cacheprovider', '--rootdir', ROOT,
        ROOT / 'test' / 'once' / 'test_tf2_ros_programs.py',
        TEST_PYTHON=str(directory / 'python'))
    assert run(directory / 'python', '-c', IMPORT) == 'site-packages\n'
    assert run(directory / 'tf_doctor', '--explain', 'past').startswith(
        'Extrapolation into the past\n\nCause. ')
    if sys.version_info < (3, 11):
        return
    run(directory / 'pip', 'install', 'evo', HOME=os.environ.get('HOME', ''))
    bags.make(tmp_path / 'walk', 'mcap', bags.walk())
    run(directory / 'evo_traj', 'bag2', 'walk', '/tf:map.base_link', '--save_as_tum')
    times, *positions, qx, qy, qz, qw = np.loadtxt(tmp_path / 'tf_map.base_link.tum').T
    moved = np.arange(101) / 10.0  # map -> odom is (1, 2, 3); base_link moves along x at 1 m/s
    assert np.allclose(times, 100.0 + moved)
    assert np.allclose(positions, [1.0 + moved, np.full(101, 2.0), np.full(101, 3.0)])
    assert np.allclose([qx, qy, qz, qw], [[0.0], [0.0], [0.0], [1.0]])
    bag = bags.make(tmp_path / 'arm', 'mcap', Arm().messages())
    assert tf_trajectory.main(['--bag', str(bag), 'map', 'end_effector', '-o',
                               str(tmp_path / 'arm.tum')]) == 0
    run(directory / 'python', '-c', READ)
    seconds, *positions = np.load(tmp_path / 'read.npy').T
    assert len(seconds) == 501
    assert np.allclose(np.diff(seconds), 0.05, atol=1e-6)
    expected = hand(np.rint(seconds * 1e9).astype(np.int64))
    assert abs(np.transpose(positions) - expected[:, :3]).max() < 1e-6
