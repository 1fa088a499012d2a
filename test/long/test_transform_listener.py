"""The ends of a listener, fifty times each; a publisher that is killed."""

import signal

from endings import end_in_every_order, without_library_lines
from environment import ROOT
from processes import ARM, TIMEOUT
import pytest
from rclpy.duration import Duration
from rclpy.time import Time

from puretf import Buffer, TransformListener

ENDINGS = str(ROOT / 'test' / 'support' / 'endings.py')


@pytest.mark.parametrize('where', ['main', 'executor', 'thread'])
def test_every_order_of_ending(domain_id, capfd, where):
    """unregister, destroy_node and shutdown end a listener in any order, in any thread."""
    for _ in range(50):
        end_in_every_order(domain_id, where)
    assert without_library_lines(capfd.readouterr().err) == ''


@pytest.mark.parametrize('way', ['end', 'exit', 'spin', 'lookup'])
def test_the_end_of_a_program(start, way):
    """A program ends cleanly by its last line, sys.exit(), and by Ctrl-C in a spin or a lookup."""
    for _ in range(50):
        process = start(ENDINGS, way)
        if way in ('spin', 'lookup'):
            process.line_with('ready')
            process.end(signal.SIGINT)
        assert process.exit_code() == 0
        assert without_library_lines(process.output) in ('', 'ready\n')


def test_a_publisher_that_was_killed_comes_back(ros, start, kill):
    """Transforms of its successor are received like those of the first publisher."""
    buffer = Buffer(node=ros.node)
    listener = TransformListener(buffer, ros.node)
    last = Time()
    for _ in range(5):
        arm = start(*ARM)
        buffer.lookup_transform('base_link', 'end_effector', last, Duration(seconds=TIMEOUT))
        kill(arm)
        last = buffer.get_latest_common_time('base_link', 'end_effector') + Duration(nanoseconds=1)
    listener.unregister()
