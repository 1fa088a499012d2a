"""The MessageFilter for a second, at a thousand messages a second."""

from environment import ROOT
from geometry_msgs.msg import PointStamped
from processes import TIMEOUT

from puretf import MessageFilter


def test_a_thousand_messages_a_second(ros, listening, start):
    """
    All are passed on in order, though their transforms arrive 5 ms after them.

    There are not more of them than DDS keeps, as this process may have to wait for others.
    """
    message_filter = MessageFilter(
        (PointStamped, 'points', 1000), listening, 'map', 1000, ros.node)
    numbers: list[int] = []
    message_filter.registerCallback(lambda message: numbers.append(int(message.point.x)))
    sender = start(str(ROOT / 'bench' / 'filtering.py'), 'send', '1000', '1')
    ros.until(lambda: 'sent' in sender.output, 3 * TIMEOUT)
    ros.until(lambda: len(numbers) == 1000)
    assert numbers == sorted({*numbers})
    assert not any(message_filter.dropped.values())
