"""Print the newest transform of every frame on /tf and /tf_static once a second."""

import signal
from threading import Event

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time

from puretf import Buffer, TransformException, TransformListener


class Listener(Node):
    """A node that looks up the pose of every frame in its parent once a second."""

    def __init__(self) -> None:
        """Create the node, its buffer, its listener and a timer."""
        super().__init__('listen')
        self._buffer = Buffer(node=self)
        self._listener = TransformListener(self._buffer, self)
        self.create_timer(1.0, self._print)

    def _print(self) -> None:
        """Print a line for each frame; the timer calls this."""
        frames = self._buffer.frames()
        if not frames:
            print('nothing on /tf yet', flush=True)
        for frame in frames:
            try:
                transform = self._buffer.lookup_transform(frame.parent, frame.name, Time())
            except TransformException as error:
                print(error, flush=True)
                continue
            p, q = transform.transform.translation, transform.transform.rotation
            print(f'{frame.parent:>12} -> {frame.name:12} '
                  f'xyz {p.x:6.3f} {p.y:6.3f} {p.z:6.3f}   '
                  f'xyzw {q.x:6.3f} {q.y:6.3f} {q.z:6.3f} {q.w:6.3f}', flush=True)


stop = Event()
for signal_number in signal.SIGINT, signal.SIGTERM:
    signal.signal(signal_number, lambda *_: stop.set())
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = Listener()
while not stop.is_set():
    rclpy.spin_once(node, timeout_sec=0.1)
rclpy.shutdown()
