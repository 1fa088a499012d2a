"""Time that goes back, as of a bag that is played in a loop: who is named, what is forgotten."""

from typing import Any

import pytest

from puretf import TransformBuffer
from puretf_tools.inspection.time_watch import TimeWatch

S = 10**9
T = 1_700_000_000 * S
POSE = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0


class Listener:
    """A buffer of 40 s, and the clock of its watch; the name of a publisher is its gid."""

    def __init__(self):
        """Start at the time T."""
        self.buffer, self.ended = TransformBuffer(40 * S), set()
        self.now, self._said = 0.0, ''
        this: Any = self
        self._watch = TimeWatch(this, lambda: self.now)

    def names_of(self, gids):
        """Return the names of nodes."""
        return {gid: f'/{gid}' for gid in gids}

    def is_present(self, gid):
        """Return whether a publisher exists."""
        return gid not in self.ended

    def play(self, seconds, *streams):
        """
        Play at 10 Hz, and return what the watch says, without repetitions.

        :param streams: a publisher, the time of its stamps minus the clock (s), and its frames.
        """
        said = []
        for _ in range(round(seconds * 10)):
            self.now += 0.1
            for sender, offset, *frames in streams:
                for frame in frames:
                    self.buffer.insert(T + round((self.now + offset) * S), 'map', frame, POSE,
                                       sender)
            if (text := self._watch.follow()) != self._said:
                self._said = text
                said.append(text)
        return said


def back(node, seconds):
    """Return the text of a jump."""
    return f'transforms arrive from /{node}, but their time went back by {seconds} s'


@pytest.mark.parametrize(('distance', 'written'), [
    (1000, '1000'), (130, '130'), (20, '20'), (5, '5.0')])
def test_a_publisher_that_goes_back(distance, written):
    """Whether its transforms are too old for the buffer or not, those of before are forgotten."""
    listener = Listener()
    listener.buffer.insert(0, 'map', 'post', POSE, 'other', is_static=True)
    assert listener.play(3.0, ('bag', 0, 'base', 'hand'), ('imu', 0, 'imu')) == []
    assert listener.play(2.0, ('bag', -distance, 'base', 'hand'), ('imu', 0, 'imu')) == [
        back('bag', written)]
    frames = {frame.name: frame for frame in listener.buffer.frames()}
    assert frames['base'].latest == frames['base'].arrived == T + round(
        (listener.now - distance) * S)
    assert frames.keys() == {'post', 'base', 'hand', 'imu'}
    assert listener.play(12.0, ('bag', -distance, 'base', 'hand'), ('imu', 0, 'imu')) == ['']


def test_a_loop():
    """Each turn is a jump."""
    listener = Listener()
    said = [listener.play(12.0, ('bag', -12 * turn, 'base')) for turn in range(3)]
    assert said == [[], [back('bag', 12), ''], [back('bag', 12), '']]


@pytest.mark.parametrize('streams', [
    [('a', 0, 'base'), ('b', -30, 'hand')],  # each is behind the other all the time
    [('a', 0, 'base'), ('b', -30, 'base')], [('a', 0, 'base'), ('b', -300, 'base')],
    [('a', 0, 'base'), ('a', -0.9, 'base')]])
def test_publishers_that_do_not_go_back(streams):
    """Not even if one of them is always behind another one of the same frame."""
    assert Listener().play(10.0, *streams) == []


def test_stamps_that_do_not_change_and_silence():
    """What has stopped has not gone back."""
    listener = Listener()
    listener.play(3.0, ('a', 0, 'base'))
    listener.buffer.insert(T + S, 'map', 'base', POSE, 'a')
    assert listener.play(0.5) == []
    listener = Listener()
    listener.play(3.0, ('a', 0, 'base'))
    for _ in range(50):
        listener.buffer.insert(T + 3 * S, 'map', 'base', (1.0, *POSE[1:]), 'a')
        assert listener.play(0.1) == []


@pytest.mark.parametrize(('distance', 'ends'), [(130, False), (130, True), (20, True)])
def test_newer_transforms_of_another_publisher(distance, ends):
    """They stay while that one exists: it may send more of them."""
    listener = Listener()
    listener.play(3.0, ('a', 0, 'base'))
    if ends:
        listener.ended.add('a')
    said = listener.play(2.0, ('b', -distance, 'base'))
    assert said[0] == back('b', distance) + ' (newer ones are from /a)' * (not ends)
    frame, = listener.buffer.frames()
    assert frame.authority == ('b' if ends else 'a')
    assert (frame.arrived, frame.sender) == (T + round((listener.now - distance) * S), 'b')


def test_one_frame_of_a_publisher():
    """The others would be lost."""
    listener = Listener()
    listener.play(3.0, ('a', 0, 'base', 'hand'))
    said = listener.play(2.0, ('a', 0, 'base'), ('a', -20, 'hand'))
    assert said[0] == back('a', 20)
    assert {frame.name: frame.oldest for frame in listener.buffer.frames()}['base'] < T + S
