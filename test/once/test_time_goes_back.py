"""Commands that listen while the stamps of a publisher go back, as those of a bag in a loop."""

import re
from time import monotonic

from cli_runner import call
import pytest
from ros_node import stamped

from puretf import TransformBroadcaster
from puretf_tools.commands import tf2_echo, tf2_monitor, view_frames

S = 10**9
T = 1_700_000_000 * S
#: The stamps go back by 130 s, and on until a command looks: by 129 s or more. The transforms
#: before would be kept for 10 s.
CAUSE = 'transforms arrive from /test, but their time went back by 1'


@pytest.fixture
def domain(ros):
    """A domain in which the stamps of a publisher go back, 2 s after a listener has come."""
    broadcaster, begin = TransformBroadcaster(ros.node), monotonic()

    def send():
        nonlocal begin
        if not broadcaster.pub_tf.get_subscription_count():
            begin = monotonic()
        passed = monotonic() - begin
        broadcaster.sendTransform(
            stamped('map', 'robot', T + round((passed - 130.0 * (passed > 2.0)) * S), 1.0))

    ros.node.create_timer(0.02, send)
    with ros.spinning():
        yield ros.domain


def test_tf2_echo_goes_on(domain):
    """It says the cause once, and then prints the transforms that arrive."""
    output = call(tf2_echo.main, 'map', 'robot', '10', domain=domain,
                  until=lambda text: text.partition(CAUSE)[2].count('At time') > 5).stdout
    before, _, after = output.partition(CAUSE)
    assert output.count(CAUSE) == 1
    assert 'Failure' not in output
    stamps = [[int(second) for second in re.findall(r'At time (\d+)', part)]
              for part in (before, after)]
    assert min(stamps[0]) >= T // S > max(stamps[1])


def test_view_frames(domain):
    """A warning says the cause; the tree is that of the frames that arrive."""
    result = call(view_frames.main, '--text', '-t', '4', domain=domain)
    assert f'\nview_frames: warning: {CAUSE}' in result.stderr
    assert re.search(r'robot +\d+\.\d Hz', result.stdout)


@pytest.mark.parametrize(('command', 'arguments'), [
    (view_frames, ['--watch']), (tf2_monitor, []), (tf2_monitor, ['map', 'robot'])])
def test_commands_that_print_again_and_again(domain, command, arguments):
    """A warning says the cause."""
    assert call(command.main, *arguments, domain=domain,
                until=lambda text: f'Warning: {CAUSE}' in text).code == 0
