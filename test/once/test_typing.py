"""Type checkers know this package from outside."""

import os
import subprocess
import sys

from environment import ROOT

#: Programs of users, with and without ROS.
PROGRAMS = """
from puretf import SECOND, TransformBuffer, exact_time
buffer = TransformBuffer(cache_time=10 * SECOND)
buffer.insert(0, 'map', 'odom', (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), is_static=True)
print(exact_time(buffer.lookup_transform('map', 'odom', 0).stamp))
is_there: bool = buffer.can_transform('map', 'odom')
is_there, text = buffer.can_transform('map', 'odom', return_debug_tuple=True)
---
import puretf
import puretf.bag
import puretf.rotations
def frames(path: str) -> list[str]:
    with puretf.bag.open(path) as opened:
        return [frame.name for frame in opened.read().frames()]
---
from puretf import Buffer, TransformListener, TransformBroadcaster
from rclpy.node import Node
class Listener(Node):
    def __init__(self) -> None:
        super().__init__('listener')
        self.buffer = Buffer(node=self)
        self.listener = TransformListener(self.buffer, self)
        self.broadcaster = TransformBroadcaster(self)
"""


def test_programs_of_users_have_types(tmp_path):
    """Type checkers find the types of this package from outside."""
    files = [tmp_path / f'program_{i}.py' for i in range(PROGRAMS.count('---') + 1)]
    for file, program in zip(files, PROGRAMS.split('---')):
        file.write_text(program)
    done = subprocess.run(
        [sys.executable, '-m', 'mypy', '--strict', '--no-incremental', *files], cwd=tmp_path,
        env={**os.environ, 'MYPYPATH': str(ROOT)}, text=True, capture_output=True, timeout=300)
    assert done.returncode == 0, done.stdout
