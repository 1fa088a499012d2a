"""The QoS of publishers and subscriptions, as users give it."""

from typing import Any, Optional, Union

from rclpy.qos import QoSProfile


def profile(qos: Optional[Union[QoSProfile, int]], depth: int, **policies: Any) -> QoSProfile:
    """
    Make a profile of what was given.

    :param qos: a profile, taken as it is; or a depth; None: the depth that is usual.
    :param depth: that one.
    :param policies: what a profile has that was not given.
    """
    if qos is None or isinstance(qos, int):
        return QoSProfile(depth=depth if qos is None else qos, **policies)
    return qos
