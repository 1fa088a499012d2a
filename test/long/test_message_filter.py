"""The MessageFilter for a second, at a thousand messages a second."""

from geometry_msgs.msg import PointStamped
from processes import TIMEOUT

from puretf import MessageFilter

#: Publish messages with increasing numbers, and their transforms 5 ms later.
SENDER = """if True:
    import time
    from geometry_msgs.msg import PointStamped
    import rclpy
    from rclpy.time import Time
    from puretf import TransformBroadcaster

    rclpy.init()
    node = rclpy.create_node('sender')
    points = node.create_publisher(PointStamped, 'points', 1000)
    broadcaster = TransformBroadcaster(node)
    prepared = broadcaster.prepare([('map', 'odom'), ('odom', 'laser')])
    while not (points.get_subscription_count() and broadcaster.pub_tf.get_subscription_count()):
        time.sleep(0.01)
    message, stamps, number = PointStamped(), [], 0
    message.header.frame_id = 'laser'
    begin = time.monotonic()
    while number < 1000 or stamps:
        now = time.time_ns()
        if number < 1000 and time.monotonic() >= begin + number / 1000:
            message.header.stamp, message.point.x = Time(nanoseconds=now).to_msg(), float(number)
            points.publish(message)
            stamps.append(now)
            number += 1
        while stamps and now >= stamps[0] + 5_000_000:
            prepared.send(stamps.pop(0), 2 * [[0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    print('sent', flush=True)
    time.sleep(5.0)  # DDS may have to send some messages again
    """


def test_a_thousand_messages_a_second(ros, listening, start):
    """
    All are passed on in order, though their transforms arrive 5 ms after them.

    There are not more of them than DDS keeps, as this process may have to wait for others.
    """
    message_filter = MessageFilter(
        (PointStamped, 'points', 1000), listening, 'map', 1000, ros.node)
    numbers: list[int] = []
    message_filter.registerCallback(lambda message: numbers.append(int(message.point.x)))
    sender = start('-c', SENDER)
    ros.until(lambda: 'sent' in sender.output, 3 * TIMEOUT)
    ros.until(lambda: len(numbers) == 1000)
    assert numbers == sorted({*numbers})
    assert not any(message_filter.dropped.values())
