"""The QoS arguments of publishers and subscriptions."""

from typing import Any, Optional, Union

from rclpy.qos import QoSProfile


def profile(qos: Optional[Union[QoSProfile, int]], depth: int, **policies: Any) -> QoSProfile:
    """
    Return the QoS profile for an argument that is a profile, a depth or None.

    :param qos: a profile, which is returned unchanged, or a depth. None means the default depth.
    :param depth: the default depth.
    :param policies: further arguments of `QoSProfile`; not used if `qos` is a profile.
    :returns: the profile.
    """
    if qos is None or isinstance(qos, int):
        return QoSProfile(depth=depth if qos is None else qos, **policies)
    return qos
