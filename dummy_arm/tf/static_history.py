"""What is known of a frame that does not move."""

from typing import Union

from dummy_arm.tf.history import History, Pose, State
from dummy_arm.tf.samples import Samples


class StaticHistory:
    """A pose that holds at all times."""

    __slots__ = ('authority', 'only_parent', 'pose')

    is_static = True
    parents = None
    # No samples in time.
    latest = oldest = 0
    place = Samples(), 0

    def __init__(self, parent: str, pose: Pose, authority: str) -> None:
        """Keep what is given."""
        self.only_parent, self.pose, self.authority = parent, pose, authority

    @property
    def all_parents(self) -> tuple[str]:
        """The parent."""
        return (self.only_parent,)

    def __len__(self) -> int:
        return 1

    def state(self, until: int) -> State:
        """Return what is known of the frame, at any time."""
        return self.only_parent, self.authority, True, 1, 0, 0

    def pose_at(self, time: int) -> Pose:
        """Read the pose."""
        return self.pose

    def newest_parent(self) -> str:
        """Return the parent."""
        return self.only_parent

    def distance_to(self, time: int) -> int:
        """Return 0: it covers all times."""
        return 0

    def parent_at(self, time: int) -> str:
        """Tell the parent."""
        return self.only_parent


AnyHistory = Union[History, StaticHistory]
