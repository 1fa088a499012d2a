"""The command `tf_trajectory` as a user calls it: it records what it receives; its bar."""

import csv
from pathlib import Path
import re

from arms import hand
from cli_runner import call
import numpy as np
from processes import ARM, tool
from ros_node import stamped

from puretf import TransformBroadcaster
from puretf_tools.commands.tf_trajectory import main

S = 10**9


def test_the_running_arm(start, tmp_path):
    """The poses are those of the arm at the exact stamps; what arrives first has moving frames."""
    arm = start(*ARM, '--ros-args', '-r', '/tf_static:=/elsewhere')
    (begin,) = re.findall(r't = 0 at (\d+) ns', arm.line_with('t = 0'))
    process = start(*tool('tf_trajectory', 'base_link', 'end_effector', '--time', '0.5', '-o',
                          'arm.csv'), cwd=tmp_path)
    assert process.exit_code() == 0, process.output
    with (tmp_path / 'arm.csv').open(newline='') as file:
        rows = [*csv.DictReader(file)]
    assert re.fullmatch(rf'wrote arm\.csv: {len(rows)} rows from .* s\n', process.output)
    positions = [[float(row[name]) for name in ('x_m', 'y_m', 'z_m', 'yaw_rad')] for row in rows]
    expected = hand([int(row['stamp_ns']) for row in rows], int(begin))[:, [0, 1, 2, 5]]
    np.testing.assert_allclose(positions, expected, rtol=0.0, atol=1e-9)


def test_ctrl_c_ends_the_recording(ros, domain_id, monkeypatch, tmp_path):
    """What has been received is written; here, the topics are those of a namespace."""
    monkeypatch.chdir(tmp_path)
    broadcaster = TransformBroadcaster(ros.node, tf_topic='/robot/tf')
    ros.node.create_timer(0.05, lambda: broadcaster.sendTransform(
        [stamped('map', 'base', 1000 * S + i, x=i) for i in range(20)]))
    with ros.spinning():
        result = call(main, 'map', 'base', '--namespace', 'robot', '--time', '1000', '-o',
                      'base.tum', domain=domain_id, columns=80,
                      until=lambda text: 'listening' in text)
    assert result.code == 0
    assert result.stdout == (
        'wrote base.tum: 20 rows from 1000.000000000 s to 1000.000000019 s\r\n')
    assert [line.split()[:2] for line in Path('base.tum').read_text().splitlines()] == [
        [f'1000.{i:09d}', f'{i}.0'] for i in range(20)]


def test_a_gap_in_what_is_received(ros, domain_id, monkeypatch, tmp_path):
    """A line says when it was, by stamps; the rows are at the stamps of another frame."""
    monkeypatch.chdir(tmp_path)
    stamps = [1000 * S + i * S // 20 for i in range(81)]
    broadcaster = TransformBroadcaster(ros.node)
    ros.node.create_timer(0.05, lambda: broadcaster.sendTransform([
        *(stamped('base', 'tool', stamp) for stamp in stamps),
        *(stamped('map', 'base', stamp) for i, stamp in enumerate(stamps) if not 20 < i < 60)]))
    with ros.spinning():
        result = call(main, 'map', 'tool', '--time', '1000', '-o', 'tool.csv', domain=domain_id,
                      columns=200, until=lambda text: 'listening' in text)
    assert result.code == 0
    assert 'wrote tool.csv: 81 rows from ' in result.stdout
    assert result.stderr.endswith(
        'tf_trajectory: 39 rows are interpolated over gaps without data; in the longest, map -> '
        'base has none between 1001.00 and 1003.00 s\r\n')
