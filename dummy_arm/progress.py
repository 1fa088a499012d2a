"""A progress bar on a terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import sys
from typing import Any


@contextmanager
def progress(total: float, **kwargs: Any) -> Iterator[Callable[[float], object]]:
    """
    Show a progress bar from here to the end of the block.

    Where stderr is no terminal, or tqdm is not installed, nothing is shown.

    :param total: what the bar counts up to.
    :param kwargs: of tqdm: `desc`, `bar_format`.
    :returns: a function that shows how much is done.
    """
    try:
        from tqdm import tqdm
    except ImportError:
        tqdm = None
    if tqdm is None or not (sys.stderr and sys.stderr.isatty()):
        yield lambda done: None
        return
    with tqdm(total=total, leave=False, **kwargs) as bar:
        yield lambda done: bar.update(done - bar.n)
