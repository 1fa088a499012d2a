"""`make demo`: the arm and the page together."""

import os
from pathlib import Path
import signal
import subprocess
import sys

from endings import without_library_lines
from environment import ROOT
import pytest

pytestmark = pytest.mark.skipif(
    not Path(sys.prefix, 'installed').is_file(),
    reason='this is not the environment of the Makefile: `make demo` would create another one')
pytest.importorskip('viser', reason='viser, which serves the page, is not installed')


def test_the_progress_of_an_installation(tmp_path):
    """Packages are counted, those of an index and those of a directory."""
    path = tmp_path / 'printed'
    path.write_text(
        'Collecting numpy<2 (from dummy-arm==0.4.0)\n'
        'Processing /lab/wheels/ros_jazzy_rclpy-7.1-cp312-cp312-linux_x86_64.whl (from x)\n'
        'Installing collected packages: numpy, ros-jazzy-rclpy\n')
    done = subprocess.run(['make', '--silent', f'--eval=show: ; @$(PROGRESS) < {path}', 'show'],
                          cwd=ROOT, text=True, check=True, stdout=subprocess.PIPE)
    assert done.stdout == (
        'package 1: numpy\npackage 2: ros_jazzy_rclpy\nunpacking 2 packages\n')


@pytest.mark.parametrize(('signal_number', 'to_all'), [
    (signal.SIGINT, True), (signal.SIGTERM, False)], ids=['Ctrl-C', 'SIGTERM to make'])
def test_it_prints_the_address_and_ends(domain_id, signal_number, to_all):
    """It runs until Ctrl-C or until SIGTERM to make, and no process of it is left behind."""
    # The variables are those of a shell, even if these tests are run by make.
    environment = {name: value for name, value in os.environ.items()
                   if not name.startswith(('MAKE', 'MFLAGS'))}
    with subprocess.Popen(
            ['make', 'demo', f'VENV={sys.prefix}', '-o', f'{sys.prefix}/installed'], cwd=ROOT,
            text=True, env={**environment, 'ROS_DOMAIN_ID': str(domain_id)},
            start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as make:
        assert make.stdout is not None
        missing = {'look at http://127.0.0.1:', 'publishing map -> base_link'}
        try:
            while missing:
                line = make.stdout.readline()
                assert line
                missing -= {text for text in missing if text in line}
        finally:
            (os.killpg if to_all else os.kill)(make.pid, signal_number)
        rest = without_library_lines(make.stdout.read())  # until every process has closed it
    assert 'Error' not in rest
    assert 'Traceback' not in rest
    with pytest.raises(ProcessLookupError):
        os.killpg(make.pid, 0)
