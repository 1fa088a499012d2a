"""What can be looked at: a bag; `live` has the other, what a node hears."""

from typing import NamedTuple, Optional, Protocol, TYPE_CHECKING, Union

from dummy_arm.tf import BufferCore
from dummy_arm.tf.frames import Frame
from dummy_arm.tools.forest import frequency
from dummy_arm.view.player import Player

if TYPE_CHECKING:
    from dummy_arm.tf import Buffer

#: The buffer of a bag, or of a node.
AnyBuffer = Union[BufferCore, 'Buffer']


class Facts(NamedTuple):
    """How a frame is published."""

    rate: Optional[float]  #: Hz; None: not known
    delay: Optional[float]  #: the average from the stamp to the reception (s); None: not known
    publisher: str


class Source(Protocol):
    """What frames come from."""

    name: str
    buffer: AnyBuffer
    player: Optional[Player]  #: the time of a bag; None: it is now

    def facts(self, frame: Frame) -> Facts:
        """Tell how a frame is published."""

    def why_none(self) -> str:
        """Tell what may be the reason that there is no frame."""


class Bag:
    """A bag that is played."""

    def __init__(self, buffer: BufferCore, name: str) -> None:
        """Stand at its begin."""
        self.buffer: AnyBuffer = buffer
        self.name = name
        self.player: Optional[Player] = Player(buffer.frames())

    def facts(self, frame: Frame) -> Facts:
        """Tell what was recorded."""
        return Facts(frequency(frame), None, frame.authority)

    def why_none(self) -> str:
        """Tell that they come."""
        return 'There is none yet at this time of the bag.'
