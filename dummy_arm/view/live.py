"""What a node hears, to be looked at."""

from typing import Optional

from rclpy.node import Node

from dummy_arm.tf.frames import Frame
from dummy_arm.tools.frame_listener import FrameListener
from dummy_arm.tools.traffic import Traffic
from dummy_arm.view.player import Player
from dummy_arm.view.source import AnyBuffer, Facts
from dummy_arm.view.trail import LENGTH


class Live:
    """What is on /tf and /tf_static."""

    def __init__(self, node: Node) -> None:
        """Begin to listen."""
        self.name = '/tf and /tf_static'
        self.player: Optional[Player] = None
        self._asked = ''
        self._traffic: Optional[Traffic] = None
        self._listening = FrameListener(node, LENGTH)
        self.buffer: AnyBuffer = self._listening.buffer

    def facts(self, frame: Frame) -> Facts:
        """Tell how a frame is published; rate and delay since it was first asked for."""
        listener = self._listening.listener
        messages, _ = listener.received()
        if self._traffic is None or frame.name != self._asked:
            self._asked = frame.name
            self._traffic = Traffic(self._listening.now, frame.name)
        else:
            self._traffic.observe(messages)
        publisher = listener.names_of([frame.authority])[frame.authority]
        streams = [stream for stream in self._traffic.streams(listener.names_of, listener.present)
                   if stream.frame == frame.name and stream.is_present]
        summary = next((stream.summary for stream in streams if stream.sender == publisher), None)
        if len(streams) > 1:
            publisher = f'{" and ".join(stream.sender for stream in streams)}: more than one'
        if summary is None:
            return Facts(None, None, publisher)
        return Facts(summary.rate, summary.average_delay, publisher)

    def why_none(self) -> str:
        """Tell what may be the reason that nothing was heard."""
        return self._listening.why_none()
