"""The program of docs/bags.md that examines bags on Dask, on a LocalCluster with two workers."""

import re
import subprocess
import sys

from environment import ROOT
from pages import BLOCKS
import pytest

bags = pytest.importorskip('bags')


def test_many_bags_on_dask(tmp_path):
    """A broken bag has its line, too, and one that cannot be downloaded; there is no network."""
    pytest.importorskip('distributed')
    for number in range(5):
        bags.file_of(bags.make(tmp_path / f'{number}', 'mcap', bags.walk())).rename(
            tmp_path / f'walk-{number}.mcap')
    (tmp_path / 'cut.mcap').write_bytes((tmp_path / 'walk-0.mcap').read_bytes()[:-100])
    (tmp_path / 'gone.mcap').symlink_to('nowhere')
    (block,) = (block for block in BLOCKS if block.needs == 'dask')
    program = block.code.replace('s3://my-bucket/', f'file://{tmp_path}/')
    assert program != block.code
    (tmp_path / 'program.py').write_text(program)
    done = subprocess.run(
        ['unshare', '--net', 'sh', '-c', 'ip link set lo up; exec "$0" "$@"', sys.executable,
         tmp_path / 'program.py'], cwd=ROOT, capture_output=True, text=True, check=False)
    lines = sorted(done.stdout.splitlines())
    assert len(lines) == 7, done.stderr
    assert re.fullmatch(r'(file://\S+/cut\.mcap) \1 cannot be read: it ends too early\..*',
                        lines[0])
    assert re.fullmatch(r'file://\S+/gone\.mcap it cannot be downloaded: .+', lines[1])
    for number, line in enumerate(lines[2:]):
        assert re.fullmatch(rf'(file://\S+/walk-{number}\.mcap) healthy: 102 transforms of 3 '
                            r'frames in \1', line)
