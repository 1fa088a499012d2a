"""Limits of names, where ROS is needed; the others are in test/unit/test_limits.py."""

from puretf import Buffer

T = 1_700_000_000_000_000_000
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def test_logs_of_rclpy_take_lone_surrogates():
    """The logger of rclpy cannot encode them, and would raise in the listener's thread."""
    buffer = Buffer()
    for _ in range(2):
        assert not buffer.insert(T, 'map\udc80', 'map\udc80', STILL)
