"""Look up where a frame was half a second ago, seen from a frame now; written for tf2_ros."""

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.time import Time
from tf2_ros import TransformException
from tf2_ros.buffer import Buffer
from tf2_ros.transform_listener import TransformListener


class TimeTravel(Node):
    """A node that looks up turtle1 of the past in turtle1 of now."""

    def __init__(self):
        """Create the buffer, the listener and the timer."""
        super().__init__('time_travel')
        self.tf_buffer = Buffer()
        self.tf_listener = TransformListener(self.tf_buffer, self)
        self.timer = self.create_timer(0.1, self.on_timer)

    def on_timer(self):
        """Look up the transform between two times."""
        when = self.get_clock().now() - Duration(seconds=0.5)
        try:
            t = self.tf_buffer.lookup_transform_full(
                target_frame='turtle1', target_time=Time(), source_frame='turtle1',
                source_time=when, fixed_frame='world', timeout=Duration(seconds=0.05))
        except TransformException as ex:
            print(f'could not transform: {ex}', flush=True)
            return
        p = t.transform.translation
        print(f'moved {(p.x ** 2 + p.y ** 2 + p.z ** 2) ** 0.5:.3f} m', flush=True)


rclpy.init()
try:
    rclpy.spin(TimeTravel())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
