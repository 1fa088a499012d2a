"""Print, once a second, the newest transform of every frame on /tf and /tf_static."""

import argparse
import sys

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from dummy_arm.command import run_node
from dummy_arm.tf import TFMessage


class Listener(Node):
    """Keeps the newest transform of every child frame."""

    def __init__(self) -> None:
        super().__init__('listen')
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._newest: dict[str, TransformStamped] = {}
        self.create_subscription(TFMessage, '/tf', self._take, 100)
        self.create_subscription(TFMessage, '/tf_static', self._take, latched)
        self.create_timer(1.0, self._print)

    def _take(self, message: TFMessage) -> None:
        self._newest.update((transform.child_frame_id, transform)
                            for transform in message.transforms)

    def _print(self) -> None:
        if not self._newest:
            print('nothing on /tf yet', flush=True)
        for child, transform in self._newest.items():
            p, q = transform.transform.translation, transform.transform.rotation
            print(f'{transform.header.frame_id:>12} -> {child:12} '
                  f'xyz {p.x:6.3f} {p.y:6.3f} {p.z:6.3f}   '
                  f'xyzw {q.x:6.3f} {q.y:6.3f} {q.z:6.3f} {q.w:6.3f}', flush=True)


sys.exit(run_node(argparse.ArgumentParser(prog='listen', description=__doc__), Listener))
