"""Wait for a transform in a coroutine, without blocking the executor; written for tf2_ros."""

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
import rclpy.time
from tf2_ros import LookupException
from tf2_ros.buffer import Buffer
from tf2_ros.transform_listener import TransformListener


class AsyncWait(Node):
    """A node that looks up a transform ten times a second."""

    def __init__(self):
        """Create the buffer, the listener and the timer."""
        super().__init__('async_wait')
        self.tf_buffer = Buffer()
        self.tf_listener = TransformListener(self.tf_buffer, self)
        self.create_timer(0.1, self.on_timer)

    async def on_timer(self):
        """Look up a transform and await the result."""
        print('waiting', flush=True)
        try:
            transform = await self.tf_buffer.lookup_transform_async(
                'wheel', 'sonar', rclpy.time.Time())
            print(f'got transform from {transform.child_frame_id}', flush=True)
        except LookupException as error:
            print(f'failed: {error!r}', flush=True)


rclpy.init()
try:
    rclpy.spin(AsyncWait())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
