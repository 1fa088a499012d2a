"""The command `tf2_monitor`: what is published now, late, twice, in simulated time, or not."""

import re

from cli_runner import call
from processes import tool
import pytest
from rclpy.time import Time
from ros_node import stamped
from rosgraph_msgs.msg import Clock

from puretf import publisher_listener, StaticTransformBroadcaster, TransformBroadcaster
from puretf_tools.cli.signals import sleep
from puretf_tools.commands import tf2_monitor
from puretf_tools.commands.tf2_monitor import main

S = 10**9
SIM_TIME = '--ros-args', '-p', 'use_sim_time:=true'
RATE_AND_DELAYS = r'\d+\.\d Hz +-?\d+\.\d{6} s +-?\d+\.\d{6} s'


@pytest.fixture(autouse=True)
def often(monkeypatch):
    """Let the command print ten times a second."""
    monkeypatch.setattr(tf2_monitor, 'sleep', lambda seconds: sleep(seconds / 10))


def test_all_frames_until_a_signal(start, arm_domain):
    """It prints the rates of all frames and nodes."""
    process = start(*tool('tf2_monitor'), domain=arm_domain)
    process.line_with('RESULTS: for all frames, over the last 10 s')
    process.line_with('  end_effector ')
    process.end_normally()


def test_the_path_between_two_frames(arm_domain):
    """It prints the rates on the path, and the delay of the path."""
    chain = (r'RESULTS: for map to joint_2, over the last 10 s\n'
             r'Chain is: map -> base_link -> joint_1 -> joint_2\n'
             r'Net delay     avg = -?\d+\.\d{6} s: max = \d+\.\d{6} s\n\n'
             r'Frames:.*\n'
             r'  base_link +static +/dummy_arm\n'
             rf'  joint_1 +{RATE_AND_DELAYS}  /dummy_arm\n'
             rf'  joint_2 +{RATE_AND_DELAYS}  /dummy_arm\n\n'
             rf'All Broadcasters:.*\n +{RATE_AND_DELAYS}  /dummy_arm\n\n')
    result = call(main, 'map', '/joint_2', domain=arm_domain,
                  until=lambda text: re.search(chain, text))
    assert (result.code, result.stderr) == (0, '')


def test_it_continues_when_something_is_missing(ros, monkeypatch):
    """It prints what is missing, once with the hint, and continues; a static path has no delay."""
    monkeypatch.setattr('puretf.transform_listener._DISCOVERY', 0.5)
    broadcaster = StaticTransformBroadcaster(ros.node)
    waiting = ('Waiting for transform map ->  robot: Invalid frame ID "robot" passed to '
               'canTransform argument source_frame - frame does not exist.')
    steps = [('Nothing has arrived yet from /test.', None),
             ('No transform has been received yet.\n', ('map', 'robo')),
             (f"{waiting} Nearest known: 'robo'. More: tf_doctor --explain missing_frame\n", None),
             (f'{waiting}\n', ('map', 'robot')),
             ('Chain is: map -> robot\nNet delay     none: all transforms are static, or the time '
              'is not known\n', ('moon', 'robot')),
             ('not part of the same tree', ('map', 'robot')),
             ('Chain is: ', None)]
    seen = 0

    def until(text):
        nonlocal seen
        if steps and steps[0][0] in text[seen:]:
            if edge := steps.pop(0)[1]:
                broadcaster.sendTransform(stamped(*edge))
            seen = len(text)
        return not steps

    result = call(main, 'map', 'robot', domain=ros.domain, until=until)
    assert (result.code, steps) == (0, [])


def test_two_nodes_that_publish_one_frame(ros, other):
    """It prints a warning, as long as both nodes exist."""
    for node in ros.node, other:
        StaticTransformBroadcaster(node).sendTransform(stamped('map', 'odom'))
    warning = ('Warning: odom is published by /other and /test; a frame should have one '
               'publisher\n')
    steps = [warning, '/other (gone)\n']

    def until(text):
        if steps and steps[0] in text and steps.pop(0) == warning:
            other.destroy_node()
        return not steps

    result = call(main, domain=ros.domain, until=until)
    (gone, *_) = [block for block in result.stdout.split('RESULTS') if '(gone)' in block]
    assert re.search(r'  odom +static +/other \(gone\)\n', gone)
    assert 'Warning' not in gone


def test_sim_time_that_is_set_back(ros):
    """The delay of the path before that is forgotten."""
    clock = ros.node.create_publisher(Clock, '/clock', 10)
    broadcaster = TransformBroadcaster(ros.node)
    times = [(1000, '0.800000'), (5, '0.000000')]

    def tick():
        now, delay = times[0]
        clock.publish(Clock(clock=Time(seconds=now).to_msg()))
        broadcaster.sendTransform(stamped('map', 'odom', now * S - int(float(delay) * S)))

    def until(text):
        _, delay = times[0]
        if f'Net delay     avg = {delay} s: max = {delay} s\n' in text:
            return len(times) == 1 or not times.pop(0)
        return False

    ros.node.create_timer(0.02, tick)
    with ros.spinning():
        result = call(main, 'map', 'odom', *SIM_TIME, domain=ros.domain, until=until)
    assert (result.code, len(times)) == (0, 1)
    last = result.stdout.rpartition('RESULTS')[2]
    assert 'Warning' not in last


def test_without_a_clock(arm_domain):
    """It prints a warning, and no delay."""
    lines = (r'Warning: use_sim_time is set, but no message has arrived on /clock: delays are not '
             r'known\n(.+\n|\n)*Net delay     none: all transforms are static, or the time is not '
             r'known\n(.+\n|\n)*  joint_1 +/dummy_arm\n')
    result = call(main, 'map', 'joint_1', *SIM_TIME, domain=arm_domain,
                  until=lambda text: re.search(lines, text))
    assert result.code == 0


def test_messages_that_arrive_too_fast_are_reported(arm_domain, monkeypatch):
    """The warning has the number of messages that are not counted: the rates are too low then."""
    monkeypatch.setattr(publisher_listener, '_MOST_MESSAGES', 1)
    monkeypatch.setattr(tf2_monitor, 'sleep', sleep)  # so long that several messages arrive
    result = call(main, domain=arm_domain, until=lambda text: re.search(
        r'Warning: [1-9]\d* messages arrived too fast to be counted\n', text))
    assert result.code == 0
