"""The ends of a listener, fifty times each; a publisher that is killed."""

from endings import check_end, end_in_every_order, without_library_lines
from processes import ARM, TIMEOUT
import pytest
from rclpy.duration import Duration
from rclpy.time import Time


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
        check_end(start, way)


def test_a_publisher_that_was_killed_comes_back(listening, start, kill):
    """Transforms of its successor are received like those of the first publisher."""
    last = Time()
    for _ in range(5):
        arm = start(*ARM)
        listening.lookup_transform('base_link', 'end_effector', last, Duration(seconds=TIMEOUT))
        kill(arm)
        latest = listening.get_latest_common_time('base_link', 'end_effector')
        last = latest + Duration(nanoseconds=1)
