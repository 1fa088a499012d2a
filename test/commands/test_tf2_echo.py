"""The command `tf2_echo`: transforms of what is published now, and what is missing."""

import re

from cli_runner import call
from processes import tool
import pytest
from ros_node import stamped

from puretf import StaticTransformBroadcaster, TransformBroadcaster
from puretf_tools.cli.signals import sleep
from puretf_tools.commands import tf2_echo
from puretf_tools.commands.tf2_echo import main

S = 10**9
LATER = 1795204940_123456789  # ns


def test_it_goes_on_until_a_signal(start, arm_domain):
    """Its frames may begin with a slash, as in tf2."""
    process = start(*tool('tf2_echo', '/map', '/end_effector', '-r', '100'), domain=arm_domain)
    for _ in range(3):
        assert re.fullmatch(r'At time \d{10}\.\d{9}\n', process.line_with('At time '))
        assert re.fullmatch(r'- Translation: \[.*, 0\.300\]\n', process.line())
    process.end_normally()


@pytest.mark.parametrize(('arguments', 'period'), [((), 1.0), (('5',), 0.2), (('-r', '4'), 0.25)])
def test_the_rate(arm_domain, monkeypatch, arguments, period):
    """Between two transforms, it sleeps for the period of the rate."""
    periods = []

    def record(seconds):
        periods.append(seconds)
        sleep(min(0.05, seconds))

    monkeypatch.setattr(tf2_echo, 'sleep', record)
    result = call(main, 'map', 'end_effector', *arguments, domain=arm_domain,
                  until=lambda text: text.count('At time') > 3)
    assert result.code == 0
    assert periods[-3:] == [period] * 3


def test_a_time_exactly(monkeypatch, ros):
    """
    The time is exact to the ns, and may be between samples; a later time is waited for.

    The hint is not logged again if only its numbers change.
    """
    monkeypatch.setattr(tf2_echo, '_LOG_PERIOD', 0.2)
    moving = TransformBroadcaster(ros.node)
    ros.node.create_timer(0.05, lambda: moving.sendTransform([
        stamped('map', 'robot', LATER + i * S, x) for i, x in enumerate((1.0, 1.000001, 3.0))]))
    with ros.spinning():
        between = call(main, 'map', 'robot', '-t', '1795204941.623456789', '--once', '-p', '7',
                       domain=ros.domain)
        late = call(main, 'map', 'robot', '-t', '1795204943', domain=ros.domain,
                    until=lambda text: text.count('extrapolation into the future') > 2)
    assert between.code == 0
    assert between.stdout.startswith(
        'At time 1795204941.623456789\n- Translation: [2.0000005, 0.0000000, ')
    assert between.stdout.count('At time') == 1
    first, *others = [line for line in late.stderr.splitlines() if 'the future' in line]
    assert ' More: ' in first
    assert all(line.endswith(' from frame [robot] to frame [map].') for line in others)
    assert late.stdout == ''


def test_waiting_says_what_is_missing(monkeypatch, ros):
    """Once a second, it logs tf2's text; its causes follow once, until it changes."""
    monkeypatch.setattr(tf2_echo, '_LOG_PERIOD', 0.1)
    monkeypatch.setattr('puretf.transform_listener._DISCOVERY', 0.5)
    broadcaster = StaticTransformBroadcaster(ros.node)
    nothing = 'No transform has been received yet. Nothing has arrived yet from /test. More: '
    steps = [
        (lambda text: text.partition(nothing)[2].count('Waiting for ') > 3, [('earth', 'moon')]),
        (lambda text: "does not exist. Known frames: 'moon', 'earth'. More: " in text,
         [('map', name) for name in ('odom', 'base_link', 'base')]),
        (lambda text: "does not exist. Nearest known: 'base_link', 'base'. More: " in text,
         [('map', 'base_lnik')])]

    def until(text):
        if steps and steps[0][0](text):
            broadcaster.sendTransform([stamped(*edge) for edge in steps.pop(0)[1]])
        return 'At time 0.000000000\n' in text

    code, _, error = call(main, 'map', 'base_lnik', domain=ros.domain, until=until)
    assert (code, steps) == (0, [])
    lines = error.splitlines()
    assert re.match(
        r'\[INFO\] \[\d+\.\d{9}\] \[tf2_echo\]: Waiting for transform map ->  base_lnik: Invalid '
        'frame ID "map" passed to canTransform argument target_frame - frame does not exist',
        lines[0])
    (first,) = (i for i, line in enumerate(lines) if nothing in line)
    for line in lines[first + 1:first + 4]:
        assert line.endswith(' to canTransform argument target_frame - frame does not exist.')
    assert 'Invalid frame ID "base_lnik" passed to canTransform argument source_frame - ' in error


def test_a_failure_is_printed_and_it_goes_on(ros):
    """It prints tf2's text with the list of frames, once with the hint, then transforms again."""
    broadcaster = StaticTransformBroadcaster(ros.node)
    broadcaster.sendTransform(stamped('map', 'robot'))
    steps = [(r'At time', 'elsewhere'),
             (r'(Failure at (.|\n)*){3}', 'map'), (r'Failure at (.|\n)*At time', '')]

    def until(text):
        while steps and re.search(steps[0][0], text):
            if parent := steps.pop(0)[1]:
                broadcaster.sendTransform(stamped(parent, 'robot'))
        return not steps

    code, output, _ = call(main, 'map', 'robot', '20', domain=ros.domain, until=until)
    assert code == 0
    assert re.search(
        r"Failure at \d{10}\.\d{3}\nException thrown:Could not find a connection between 'map' "
        r"and 'robot' because they are not part of the same tree\.Tf has two or more .*\n"
        r'The current list of frames is:\n(Frame .*\n)+', output)
    first, *others = re.findall('Exception thrown:(.*)', output)
    assert re.search(r" 'robot' in the tree with root 'elsewhere'\. .*More: ", first)
    assert {*others} == {first.split(" 'map' is in the tree with root ")[0]}
    assert 'Frame robot exists with parent elsewhere.\n' in output


def test_names_of_others_cannot_control_the_terminal(ros):
    """The error about a loop lists all frames, each in a line of its own."""
    broadcaster = StaticTransformBroadcaster(ros.node)
    broadcaster.sendTransform([stamped('map', 'tool\x1b[31m'), stamped('a\x1b[2J', 'b\x07')])
    loop = [stamped('b\x07', 'a\x1b[2J'), stamped('a\x1b[2J', 'tool\x1b[31m')]

    def until(text):
        if 'At time 0.0' in text and loop:
            broadcaster.sendTransform([loop.pop(), loop.pop()])
        return r'Frame b\x07 exists with parent a\x1b[2J.' in text

    result = call(main, 'map', 'tool\x1b[31m', domain=ros.domain, until=until)
    text = result.stdout + result.stderr
    assert 'Exception thrown' in text
    assert '\x1b[2J' not in text
    assert '\x07' not in text
