"""The command `view_frames`: trees of what is published now, and drawings that are interrupted."""

import random
import re
import signal

from cli_runner import call
from processes import cpu_seconds, is_running, tool
import pytest
from rclpy.time import Time
from ros_node import eventually, stamped
from rosgraph_msgs.msg import Clock

from puretf import StaticTransformBroadcaster, TransformBroadcaster
from puretf_tools.cli import progress
from puretf_tools.cli.signals import sleep
from puretf_tools.commands import view_frames
from puretf_tools.commands.view_frames import main

S = 10**9
CLEAR = '\x1b[H\x1b[2J'


@pytest.fixture(autouse=True)
def often(monkeypatch):
    """Let --watch print ten times a second."""
    monkeypatch.setattr(view_frames, 'sleep', lambda seconds: sleep(seconds / 10))


@pytest.fixture
def publish_static(ros):
    """Publish static transforms, by `publish_static((parent, child), …)`."""
    broadcaster = StaticTransformBroadcaster(ros.node)
    return lambda *edges: broadcaster.sendTransform([stamped(*edge) for edge in edges])


def test_the_arm_is_drawn(start, arm_domain, tmp_path):
    """The command ends after the time, with exit code 0."""
    process = start(*tool('view_frames', '-t', '0.3'), domain=arm_domain, cwd=tmp_path)
    assert process.exit_code() == 0
    assert re.fullmatch(r'wrote frames\.pdf and frames\.gv: frames: \d, transforms: \d, '
                        r'root: \w+\n', process.output)
    assert (tmp_path / 'frames.pdf').read_bytes().startswith(b'%PDF')


def test_watch_prints_until_a_signal(start, arm_domain):
    """If stdout is a pipe, it prints the tree line by line, with an empty line after it."""
    process = start(*tool('view_frames', '--watch'), domain=arm_domain)
    process.line_with('end_effector')
    while process.line() != '\n':
        pass
    process.end_normally(signal.SIGTERM)


def test_no_data_is_exit_code_1_and_what_to_check(domain_id, monkeypatch, tmp_path):
    """No file is written; tf2 writes a PDF that says that there is no data."""
    monkeypatch.setattr(progress, 'DISCOVERY', 0.1)
    monkeypatch.setattr('puretf.transform_listener._DISCOVERY', 0.0)
    monkeypatch.chdir(tmp_path)
    code, output, error = call(main, '-t', '0.2', domain=domain_id)
    assert (code, output) == (1, '')
    assert error.startswith(
        'view_frames: no transform was received. 0 publishers on /tf and /tf_static '
        f'were found in ROS domain {domain_id}.')
    assert 'ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST hides other machines.' in error
    assert not [*tmp_path.iterdir()]


def test_sim_time_is_used(ros):
    """Ages are relative to the time of /clock."""
    broadcaster = TransformBroadcaster(ros.node)
    clock = ros.node.create_publisher(Clock, '/clock', 10)

    def publish():
        clock.publish(Clock(clock=Time(seconds=1000).to_msg()))
        broadcaster.sendTransform(stamped('base', 'arm', 998 * S))

    ros.node.create_timer(0.05, publish)
    with ros.spinning():
        result = call(main, '--watch', domain=ros.domain, until=lambda text: re.search(
            r'times are those of /clock, published by /test\n.*\n.*m +\? Hz +2\.000 s old', text))
    assert result.code == 0


def test_a_live_tree_on_a_terminal(arm_domain):
    """It is printed again and again in the same place."""
    result = call(main, '--watch', domain=arm_domain, columns=80,
                  until=lambda text: text.count(f'{CLEAR}map\r\n└── base_link ') > 1)
    assert result.code == 0
    assert '└── end_effector' in result.stdout


def test_a_live_tree_waits_for_its_root(ros, publish_static):
    """Until the root exists, a line says that it is missing."""
    publish_static(('map', 'base'))
    missing = "waiting for the root: frame 'tool' does not exist. Known frames: 'map', 'base'.\n"

    def until(text):
        if text.count(missing) == 1:
            publish_static(('base', 'tool'), ('tool', 'tip'))
        return re.search(r'^tool\n└── tip .*\n\n', text, re.MULTILINE)

    result = call(main, '--watch', '--root', 'tool', domain=ros.domain, until=until)
    assert result.code == 0
    assert missing in result.stdout


def test_ctrl_c_ends_the_drawing(start, tmp_path):
    """Graphviz would work for half a minute, and C code does not notice Ctrl-C."""
    bags = pytest.importorskip('bags')
    generator = random.Random(1)
    bag = bags.make(tmp_path / 'large', 'mcap', [('/tf_static', 0, [
        bags.row(0, f'f{generator.randrange(i + 1)}', f'f{i + 1}') for i in range(4000)])])
    there = tmp_path / 'there'
    there.mkdir()
    _, code, *arguments = tool('view_frames', '--bag', str(bag))
    unlimited = f'import puretf_tools.commands.view_frames as v; v.MAX_FRAMES = 10**6; {code}'
    process = start('-c', unlimited, *arguments, cwd=there)
    eventually(lambda: sum(map(cpu_seconds, process.descendants())) > 0.3)
    drawing = process.descendants()
    process.end(signal.SIGINT)
    assert process.exit_code() == 130
    eventually(lambda: not any(map(is_running, drawing)))
    assert process.output == 'view_frames: ended early by SIGINT\n'
    assert not [*there.iterdir()]
