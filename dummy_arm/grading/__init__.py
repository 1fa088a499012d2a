"""Judge the arm of the lab's final task: requirements, running hand-ins, drawings."""

from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from dummy_arm.grading.hand_ins import grade as grade

__all__ = ['grade']


def __getattr__(name: str) -> Any:
    """Import `grade` on its first use; the workers of `hand_ins` import this package, too."""
    if name == 'grade':
        from dummy_arm.grading.hand_ins import grade
        return grade
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
