"""Wait for a transform in a callback, in one of several threads; written for tf2_ros."""

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
import rclpy.time
from tf2_ros import LookupException
from tf2_ros.buffer import Buffer
from tf2_ros.transform_listener import TransformListener


class BlockingWait(Node):
    """A node that looks up a transform ten times a second."""

    def __init__(self):
        """Create the buffer, the listener and the timer."""
        super().__init__('blocking_wait')
        self.tf_buffer = Buffer()
        self.tf_listener = TransformListener(self.tf_buffer, self)
        self.create_timer(0.1, self.on_timer)

    def on_timer(self):
        """Look up a transform and block until it is available."""
        print('waiting', flush=True)
        try:
            when = rclpy.time.Time()
            self.tf_buffer.lookup_transform('wheel', 'sonar', when, timeout=Duration(seconds=5.0))
        except LookupException:
            print('not ready', flush=True)
        else:
            print('got transform', flush=True)


rclpy.init()
executor = MultiThreadedExecutor()
executor.add_node(BlockingWait())
try:
    executor.spin()
except (KeyboardInterrupt, ExternalShutdownException):
    pass
