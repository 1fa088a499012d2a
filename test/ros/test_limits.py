"""Limits of names, where ROS is needed; the others are in test/unit/test_limits.py."""

from difflib import SequenceMatcher

from dummy_arm.inspection import frame_listener
from dummy_arm.tf import Buffer

T = 1_700_000_000_000_000_000
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def test_logs_of_rclpy_take_lone_surrogates():
    """The logger of rclpy cannot encode them, and would raise in the listener's thread."""
    buffer = Buffer()
    for _ in range(2):
        assert not buffer.insert(T, 'map\udc80', 'map\udc80', STILL)


def test_missing_frames_are_compared_with_1000(ros, monkeypatch):
    """The text of tf2_echo lists the frames that exist; the nearest to the missing come first."""
    compared = []

    def matcher(_, name, other):
        compared.append(name)
        return SequenceMatcher(None, name, other)

    monkeypatch.setattr(frame_listener, 'SequenceMatcher', matcher)
    listening = frame_listener.FrameListener(ros.node)
    for i in range(3000):
        listening.buffer.insert(T, 'map', f'frame_{i}', STILL, is_static=True)
    text = listening.why_no_transform('map', 'frame_x')
    assert "the nearest names first: 'frame_0', 'frame_1'" in text
    assert text.endswith(' and 2981 more.')
    assert len(compared) == 1000
