"""Lookups with a timeout: they wait until their transforms arrive."""

from collections.abc import Callable
from time import monotonic
from typing import Any, TypeVar

from puretf._causes.facts import Waited
from puretf._core.engine import Engine
from puretf._core.wake import Wake
from puretf.exceptions import TransformException

_Result = TypeVar('_Result')

#: The longest time between two attempts (s); nothing wakes a lookup when ROS is shut down.
_RETRY_INTERVAL = 0.2


def wait(engine: Engine, timeout: float, lookup: Callable[..., _Result], *arguments: Any
         ) -> _Result:
    """
    Repeat a lookup whenever data arrive, until it succeeds or the timeout (s) is over.

    Also give up if ROS is shut down, or if the last source is removed. A thread that holds the
    lock of the buffer does not wait.

    :raises TransformException: the last error of the lookup.
    """
    try:
        with engine.reading():
            return lookup(*arguments)
    except TransformException:
        if timeout <= 0.0 or engine.is_held():
            raise
    deadline, before = monotonic() + timeout, engine.liveness()
    # No `Condition`: a KeyboardInterrupt inside of it could leave its lock held.
    wake = Wake()
    try:
        # In this order, no data are missed: the next update takes what has arrived by then, and
        # the listeners' threads do not pause afterwards, because `wakes` is not empty.
        engine.wakes.add(wake)
        engine.wake_sources()
        while True:
            # If no source is left before the update, this attempt can be the last.
            is_over = any(was and not is_now for was, is_now in zip(before, engine.liveness()))
            seen = engine.update_for_user()
            try:
                with engine.lock:
                    return lookup(*arguments)
            except TransformException as error:
                if is_over or monotonic() >= deadline:
                    error._waited = Waited(timeout, engine.find_blocked())
                    raise
            next_attempt = min(deadline, monotonic() + _RETRY_INTERVAL)
            while (wake.wait(max(0.0, next_attempt - monotonic()))
                   and engine.generation <= seen):
                pass
    finally:
        engine.wakes.discard(wake)
