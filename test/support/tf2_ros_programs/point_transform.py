"""Transform the points of a sensor into the frame of the world; written for tf2_ros."""

from geometry_msgs.msg import PointStamped
import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
import tf2_geometry_msgs
import tf2_ros


class PointTransform(Node):
    """A node that receives points and transforms them in the callback."""

    def __init__(self):
        """Create the buffer, the listener and the subscription."""
        super().__init__('point_transform')
        self.buffer = tf2_ros.Buffer(Duration(seconds=10.0))
        self.listener = tf2_ros.TransformListener(self.buffer, self)
        self.create_subscription(PointStamped, 'point', self.on_point, 10)

    def on_point(self, point):
        """Transform a point in two ways."""
        try:
            in_world = self.buffer.transform(point, 'world', timeout=Duration(seconds=1.0))
            t = self.buffer.lookup_transform('world', point.header.frame_id, point.header.stamp)
        except (tf2_ros.LookupException, tf2_ros.ConnectivityException,
                tf2_ros.ExtrapolationException) as error:
            print(f'no transform: {error}', flush=True)
            return
        assert in_world == tf2_geometry_msgs.do_transform_point(point, t)
        print(f'{in_world.header.frame_id}: {in_world.point.x:.3f} {in_world.point.y:.3f} '
              f'{in_world.point.z:.3f}', flush=True)


rclpy.init()
try:
    rclpy.spin(PointTransform())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
