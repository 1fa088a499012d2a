"""What is known of a frame that does not move."""

from typing import Union

from dummy_arm.tf.history import History, Pose
from dummy_arm.tf.samples import Samples


class StaticHistory:
    """A pose that holds at all times."""

    __slots__ = ('all_parents', 'authority', 'pose')

    is_static = True
    parents = None
    # No samples in time.
    latest = oldest = 0
    place = Samples(), 0

    def __init__(self, parent: str, pose: Pose, authority: str) -> None:
        """Keep what is given."""
        self.all_parents, self.pose, self.authority = (parent,), pose, authority

    def __len__(self) -> int:
        return 1

    def known_at(self, time: int) -> tuple[int, int]:
        """Tell how many poses there are, and that there is no stamp."""
        return 1, 0

    def pose_at(self, time: int) -> Pose:
        """Read the pose."""
        return self.pose

    def newest_parent(self) -> str:
        """Return the parent."""
        return self.all_parents[0]

    def distance_to(self, time: int) -> int:
        """Return 0: it covers all times."""
        return 0

    def parent_at(self, time: int) -> str:
        """Tell the parent."""
        return self.all_parents[0]


AnyHistory = Union[History, StaticHistory]
