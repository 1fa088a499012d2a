"""A reference implementation of TF with lists and 4 x 4 matrices: slow, and easy to check."""

import numpy as np
import pytest
from transforms3d import affines, quaternions

from puretf import TransformException

UNKNOWN, UNCONNECTED, OUT_OF_REACH = (
    'LookupException', 'ConnectivityException', 'ExtrapolationException')


class Loop(Exception):
    """The requested frames are in a loop, or below one."""


def matrix(xyz, xyzw):
    """Return the 4 x 4 matrix of a pose."""
    x, y, z, w = np.array(xyzw) / np.linalg.norm(xyzw)
    return affines.compose(xyz, quaternions.quat2mat((w, x, y, z)), np.ones(3))


def between(before, after, ratio):
    """
    Interpolate between two poses.

    The translation moves on a line. The rotation turns about one axis, by the smaller angle.
    """
    difference = quaternions.mat2quat(before[:3, :3].T @ after[:3, :3])
    axis, angle = quaternions.quat2axangle(difference if difference[0] >= 0 else -difference)
    result = np.eye(4)
    result[:3, 3] = (1 - ratio) * before[:3, 3] + ratio * after[:3, 3]
    result[:3, :3] = before[:3, :3] @ quaternions.quat2mat(
        quaternions.axangle2quat(axis, ratio * angle))
    return result


class Model:
    """A buffer: it keeps a static pose, or a list of samples, newest first, of each child."""

    def __init__(self, cache_time):
        """
        Create a buffer without frames.

        :param cache_time: how much older than the newest sample of its frame a sample may be (ns).
        """
        self.cache_time = cache_time
        self.names, self.static, self.samples = set(), {}, {}

    def insert(self, stamp, parent, child, xyz, xyzw, is_static):
        """Insert a valid pose; return False if it was refused because it is too old."""
        self.names |= {parent, child}
        sample = (stamp, parent, matrix(xyz, xyzw))
        if is_static:
            self.samples.pop(child, None)
            self.static[child] = sample
            return True
        self.static.pop(child, None)
        samples = self.samples.setdefault(child, [])
        if samples:
            limit = samples[0][0] - self.cache_time
            samples[:] = [kept for kept in samples if kept[0] >= limit]
            if stamp < limit:
                return False
        for other in samples:
            if other[:2] == sample[:2] and np.array_equal(other[2], sample[2]):
                return True
        samples.insert(sum(other[0] > stamp for other in samples), sample)
        return True

    def edge(self, child, time):
        """
        Return the parent of a frame, and its pose in the parent.

        :returns: (parent, matrix); None if the frame has no parent; False if the time is not
            covered.
        """
        if child in self.static:
            return self.static[child][1:]
        if child not in self.samples:
            return None
        samples = self.samples[child]
        if time == 0 or time == samples[0][0]:
            return samples[0][1:]
        if time == samples[-1][0]:
            return samples[-1][1:]
        if not samples[-1][0] < time < samples[0][0]:
            return False
        i = next(i for i, sample in enumerate(samples) if sample[0] <= time)
        (older, parent, before), (newer, other_parent, after) = samples[i], samples[i - 1]
        if parent != other_parent:
            return parent, before
        return parent, between(before, after, (time - older) / (newer - older))

    def ancestors(self, frame, time):
        """
        Return the chain from a frame to its root, and why it ends there.

        :returns: a list of (ancestor, matrix of the frame's pose in it), and the last result of
            `edge`: None at a root, False where data are missing.
        :raises Loop: if the chain comes back to one of its frames.
        """
        pose, chain = np.eye(4), [(frame, np.eye(4))]
        while edge := self.edge(frame, time):
            frame, pose = edge[0], edge[1] @ pose
            if frame in (name for name, _ in chain):
                raise Loop
            chain.append((frame, pose))
        return chain, edge

    def latest_common_time(self, target, source):
        """
        Return the latest time for which all dynamic edges on the newest path have data.

        :returns: time (ns); 0 if there are no such edges; None if the frames are in two trees.
        """
        chains = [[name for name, _ in self.ancestors(frame, 0)[0]] for frame in (target, source)]
        common = [name for name in chains[0] if name in chains[1]]
        if not common:
            return None
        stamps = [self.samples[name][0][0] for chain in chains
                  for name in chain[:chain.index(common[0])] if name in self.samples]
        return min((stamp for stamp in stamps if stamp), default=0)

    def lookup(self, target, source, time):
        """Return the time and the matrix, or the name of the exception."""
        if target == source:
            latest = self.samples[target][0][0] if target in self.samples else 0
            return time or latest, np.eye(4)
        if not {target, source} <= self.names:
            return UNKNOWN
        if time == 0:
            time = self.latest_common_time(target, source)
            if time is None:
                return UNCONNECTED
        from_source, source_end = self.ancestors(source, time)
        from_target, target_end = self.ancestors(target, time)
        target_poses = dict(from_target)
        for frame, pose in from_source:
            if frame in target_poses:
                return time, np.linalg.inv(target_poses[frame]) @ pose
        return OUT_OF_REACH if False in (source_end, target_end) else UNCONNECTED

    def lookup_full(self, target, target_time, source, source_time, fixed):
        """Return the target time and the matrix, or the name of the exception."""
        if not {target, source, fixed} <= self.names:
            return UNKNOWN
        first = self.lookup(fixed, source, source_time)
        second = self.lookup(target, fixed, target_time)
        if isinstance(first, str):
            return first
        return second if isinstance(second, str) else (second[0], second[1] @ first[1])


def outcome(lookup, *arguments):
    """Return the stamp and the matrix of an answer, or the name of the exception."""
    try:
        answer = lookup(*arguments)
    except TransformException as error:
        return type(error).__name__
    return answer.stamp, answer.matrix()


def are_equal(answer, expected):
    """Return True if two outcomes are equal."""
    if isinstance(answer, str) or isinstance(expected, str):
        return answer == expected
    return answer[0] == expected[0] and np.allclose(answer[1], expected[1], rtol=0, atol=1e-9)


def compare_many_with_single(buffer, target, source, times):
    """Assert that `lookup_transforms` returns what `lookup_transform` returns for each time."""
    times = [*times] * 17  # so many are looked up by numpy
    many = buffer.lookup_transforms(target, source, times)
    for translation, rotation, known, at in zip(*many, times, strict=True):
        try:
            one = buffer.lookup_transform(target, source, at)
        except TransformException:
            assert not known
            assert np.isnan([*translation, *rotation]).all()
        else:
            assert known
            assert translation == pytest.approx(one.translation, rel=0, abs=1e-12, nan_ok=True)
            assert rotation == pytest.approx(one.rotation, rel=0, abs=1e-12)
