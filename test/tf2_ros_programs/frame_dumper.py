"""Print all frames at a regular interval; written for tf2_ros."""

from fed_by_hand import FedByHand
import rclpy
from rclpy.executors import ExternalShutdownException


class FrameDumper(FedByHand):
    """Prints ten times a second."""

    def __init__(self):
        """Start the timer."""
        super().__init__('frame_dumper')
        self.create_timer(0.1, self.on_timer)

    def on_timer(self):
        """Print."""
        print(self.buffer.all_frames_as_yaml(), flush=True)


rclpy.init()
print('waiting', flush=True)
try:
    rclpy.spin(FrameDumper())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
