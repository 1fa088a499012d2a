"""Look up a transform in the callback of a future; written for tf2_ros."""

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
import rclpy.time
from tf2_ros import LookupException
from tf2_ros.buffer import Buffer
from tf2_ros.transform_listener import TransformListener


class WaitInCallback(Node):
    """A node that waits for a transform again and again."""

    def __init__(self):
        """Create the buffer, the listener and the timer."""
        super().__init__('wait_in_callback')
        self.tf_buffer = Buffer()
        self.tf_listener = TransformListener(self.tf_buffer, self)
        self.future = None
        self.create_timer(0.1, self.on_timer)

    def on_ready(self, future):
        """Look up the transform that has arrived."""
        self.future = None
        if future.result():
            try:
                self.tf_buffer.lookup_transform('wheel', 'sonar', rclpy.time.Time())
            except LookupException:
                print('no longer available', flush=True)
            else:
                print('got transform', flush=True)

    def on_timer(self):
        """Start to wait for the transform, unless the node is waiting already."""
        if self.future:
            return
        print('waiting', flush=True)
        self.future = self.tf_buffer.wait_for_transform_async(
            'wheel', 'sonar', rclpy.time.Time())
        self.future.add_done_callback(self.on_ready)


rclpy.init()
try:
    rclpy.spin(WaitInCallback())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
