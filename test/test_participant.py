"""What is done to the participant of Fast DDS."""

import time

from conftest import ARM
import pytest
from rclpy.utilities import get_rmw_implementation_identifier

from dummy_arm.participant import hear_no_more


@pytest.mark.skipif(get_rmw_implementation_identifier() != 'rmw_fastrtps_cpp',
                    reason='about Fast DDS, and there is another middleware')
def test_nobody_is_heard_of_any_more(ros, start):
    """Not of one that comes, nor that another went; and the node can be destroyed."""
    def publishers():
        return len(ros.node.get_publishers_info_by_topic('/tf'))

    first = start(*ARM)
    ros.until(lambda: publishers() == 1)
    hear_no_more(ros.context.get_domain_id() + 1)
    start(*ARM)
    ros.until(lambda: publishers() == 2)
    hear_no_more(ros.context.get_domain_id())
    start(*ARM).line()
    first.close()
    time.sleep(1.0)
    assert publishers() == 2
