"""Print all frames at a regular interval; written for tf2_ros."""

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from tf2_ros.buffer import Buffer
from tf2_ros.transform_listener import TransformListener


class FrameDumper(Node):
    """A node that prints the frames ten times a second."""

    def __init__(self):
        """Create the buffer, the listener and the timer."""
        super().__init__('frame_dumper')
        self.tf_buffer = Buffer()
        self.tf_listener = TransformListener(self.tf_buffer, self)
        self.create_timer(0.1, self.on_timer)

    def on_timer(self):
        """Print all frames as YAML."""
        print(self.tf_buffer.all_frames_as_yaml(), flush=True)


rclpy.init()
print('waiting', flush=True)
try:
    rclpy.spin(FrameDumper())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
