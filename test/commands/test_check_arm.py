"""The command check_arm where there is ROS: the arm that is running, no arm, the table."""

from importlib.util import find_spec
import re

from cli_runner import call
from geometry_msgs.msg import TransformStamped
from processes import tool
from ros_node import eventually, stamped

from dummy_arm import check_arm
from dummy_arm.check_arm import main
from dummy_arm.grading.drawing import judge
from puretf import StaticTransformBroadcaster

#: Our arm, ten times as fast, so that a few seconds show its periods.
FAST = [argument for number, speed in enumerate((3.0, 5.0, 7.0), 1)
        for argument in ('-p', f'joint_{number}.speed:={speed}')]


def test_the_arm_that_is_running(start, domain_id, tmp_path):
    """Our arm passes, here in a namespace; stamps may be old where the computer is busy."""
    start(*tool('dummy_arm', '--namespace', 'robot', '--ros-args', *FAST)).line_with('t = 0')
    result = call(main, '--time', '5', '--namespace', 'robot', '--feedback', str(tmp_path / 'in'),
                  domain=domain_id)
    lines = [line for line in result.stdout.splitlines() if re.match('(not )?ok ', line)][:24]
    assert [line for line in lines if line.startswith('not')] == [
        line for line in lines if line.startswith('not ok  the stamps')]
    assert 'base_link reaches a late listener             received\n' in result.stdout
    assert result.code == (0 if result.stdout.endswith('passed: 24 ok\n') else 1)
    assert result.stderr == ''  # no bar, since it is no terminal
    assert sorted(path.name for path in (tmp_path / 'in').iterdir()) == [
        'arm.svg', 'frames.pdf', 'report.txt']
    assert (tmp_path / 'in' / 'report.txt').read_text() == result.stdout
    if find_spec('pypdf'):
        assert judge(tmp_path / 'in' / 'frames.pdf').verdict == 'ok'


def test_no_arm(domain_id, monkeypatch):
    """What was looked at is named; test_hints.py of test/ros has the causes."""
    monkeypatch.setattr(check_arm, 'START', 0.5)
    monkeypatch.setattr('puretf.transform_listener._DISCOVERY', 0.0)
    result = call(main, domain=domain_id)
    assert (result.code, result.stdout) == (1, '')
    assert 'check_arm: no transform was received within 0.5 s. ' in result.stderr
    assert f'in ROS domain {domain_id}.' in result.stderr


def test_another_type(ros, monkeypatch):
    """A warning names the node that publishes another type than TFMessage."""
    def wait(_, what, poll):  # what is created later, and the name of a node, is discovered later
        observer = poll.__self__
        eventually(lambda: poll() or (
            observer.messages and '/test' in observer.listener.wrong_type_hint()))

    monkeypatch.setattr(check_arm, 'wait', wait)
    ros.node.create_publisher(TransformStamped, '/tf', 10)
    StaticTransformBroadcaster(ros.node).sendTransform(stamped('map', 'lamp'))
    result = call(main, domain=ros.domain)
    assert result.code == 1
    assert ('check_arm: warning: /test publishes geometry_msgs/msg/TransformStamped on /tf, not '
            in result.stderr)


def test_ctrl_c(arm_domain):
    """Nothing was judged, so the exit code is 1."""
    result = call(main, '--time', '1000', domain=arm_domain, columns=80,
                  until=lambda text: 'observing the arm' in text)
    assert result.code == 1
    assert result.stderr.endswith('check_arm: interrupted: nothing was judged\r\n')
