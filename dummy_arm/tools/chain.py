"""The way between two frames, as it is heard."""

from dummy_arm.tf import TransformException
from dummy_arm.tf.texts import shortened, visible
from dummy_arm.tf.times import SECOND
from dummy_arm.tools.frame_listener import FrameListener
from dummy_arm.tools.screen import wrapped
from dummy_arm.tools.traffic import Delays, summed_up


class Chain:
    """The way between two frames, and how old its newest transform is in the course of time."""

    def __init__(self, listening: FrameListener, ends: tuple[str, str]) -> None:
        """
        Begin to look.

        :param ends: the frames.
        """
        self._listening, self.ends = listening, ends
        self._ages, self._latest = Delays(), 0

    def sample(self) -> None:
        """Look how old the newest transform is, if there is any that moves."""
        now, before = self._listening.now(), self._latest
        self._latest = now
        if now < before - SECOND:  # time was set back; the buffer is cleared by the next time
            self._ages.clear()
            return
        try:
            latest = self._listening.buffer.get_latest_common_time(*self.ends).nanoseconds
        except TransformException:  # which `lines` tells
            return
        if latest:
            self._ages.add(now, now - latest)

    def frames(self) -> list[str]:
        """List the frames; none while they are not connected."""
        first, last = self.ends
        try:
            return self._listening.buffer.chain(last, first)
        except TransformException:
            return []

    def lines(self) -> list[str]:
        """Tell it."""
        first, last = self.ends
        if why := self._listening.why_not(first, last):
            return wrapped(visible(f'Waiting for transform {first} ->  {last}: {why}'))
        age = summed_up([self._ages], self._listening.now())
        return [f'Chain is: {" -> ".join(map(shortened, self.frames()))}',
                'Net delay     none: nothing moves' if age is None else
                f'Net delay     avg = {age.average_delay:.6f} s: max = {age.maximum_delay:.6f} s']
