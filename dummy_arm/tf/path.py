"""The way from one frame to another, edge by edge, and what it gives at a time."""

from bisect import bisect_right
from collections.abc import Sequence
from math import acos, sin, sqrt

from dummy_arm.tf.history import History, Pose
from dummy_arm.tf.static_history import AnyHistory

IDENTITY: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
#: A cosine above which its last bits tell in the result, so that tf2's bits are needed.
NEAR = 0.999999999999


class Path:
    """The edges from a source and those from a target, up to the frame where they meet."""

    __slots__ = ('edges', 'from_source', 'from_target')

    def __init__(self, from_source: Sequence[AnyHistory], from_target: Sequence[AnyHistory]
                 ) -> None:
        """Take the edges in the order of the way up."""
        self.from_source, self.from_target = from_source, from_target
        self.edges = [*from_source, *from_target]

    def is_fixed(self) -> bool:
        """Tell whether no edge changes its parent in the course of its history."""
        return all(edge.parents is None for edge in self.edges)

    def latest_common_time(self) -> int:
        """Find the newest time (ns) of which all moving edges know; 0 when none moves."""
        return min([edge.latest for edge in self.edges if edge.latest], default=0)

    def covers(self, time: int) -> bool:
        """Tell whether every edge has a pose at a time (ns)."""
        return all(edge.parent_at(time) is not None for edge in self.edges)

    def pose(self, time: int) -> Pose:
        """
        Compute the pose of the source in the target at a time (ns).

        :raises NoPose: when an edge has none.
        """
        if not self.from_target:
            return _along(self.from_source, time)
        target_from_top = inverse(_along(self.from_target, time))
        if not self.from_source:
            return target_from_top
        return compose(target_from_top, _along(self.from_source, time))


def inverse(pose: Pose) -> Pose:
    """Invert a pose."""
    x, y, z, qx, qy, qz, qw = pose
    return compose((0.0, 0.0, 0.0, -qx, -qy, -qz, qw), (-x, -y, -z, 0.0, 0.0, 0.0, 1.0))


def compose(left: Pose, right: Pose) -> Pose:
    """
    Compose a_from_b and b_from_c, of numbers or of arrays of them.

    A vector v is turned by u = 2 q x v: v + q_w u + q x u.
    """
    x, y, z, ax, ay, az, aw = left
    vx, vy, vz, bx, by, bz, bw = right
    ux, uy, uz = 2.0 * (ay * vz - az * vy), 2.0 * (az * vx - ax * vz), 2.0 * (ax * vy - ay * vx)
    return (x + vx + aw * ux + ay * uz - az * uy,
            y + vy + aw * uy + az * ux - ax * uz,
            z + vz + aw * uz + ax * uy - ay * ux,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by + ay * bw + az * bx - ax * bz,
            aw * bz + az * bw + ax * by - ay * bx,
            aw * bw - ax * bx - ay * by - az * bz)


def _along(edges: Sequence[AnyHistory], time: int) -> Pose:
    """
    Compose the poses of a chain of edges, from its lowest frame up to its highest.

    All of a lookup's time is spent here, so the formulas stand in the loop, those of `compose`
    too. Between two samples, at the ratio r, the translation is interpolated linearly and the
    rotation by slerp (K. Shoemake, Animating Rotation with Quaternion Curves, SIGGRAPH 1985), the
    short way round.
    """
    x, y, z, qx, qy, qz, qw = IDENTITY
    composed = False
    for edge in edges:
        samples, offset = edge.place
        stamps = samples.regular
        i = samples.recent
        if not (i < len(stamps) and stamps[i - 1] <= time < stamps[i]):
            samples.recent = i = (
                bisect_right(stamps, time, samples.start) if time < samples.latest
                else len(stamps))
        if samples.start < i < len(stamps):
            before = stamps[i - 1]
            r = (time - before) / (stamps[i] - before)
            s = 1.0 - r
            (px, py, pz, ax, ay, az, aw,
             nx, ny, nz, bx, by, bz, bw) = samples.read_two(
                 samples.poses, (i - 1) * samples.row + offset)
            px, py, pz = s * px + r * nx, s * py + r * ny, s * pz + r * nz
            cosine = ax * bx + ay * by + az * bz + aw * bw
            if cosine < 0.0:
                cosine, bx, by, bz, bw = -cosine, -bx, -by, -bz, -bw
            if cosine > NEAR:
                cosine = min(1.0, cosine / sqrt(
                    (ax * ax + ay * ay + az * az + aw * aw)
                    * (bx * bx + by * by + bz * bz + bw * bw)))
            angle = acos(cosine)
            if angle:
                scale = 1.0 / sin(angle)
                s, r = sin(s * angle) * scale, sin(r * angle) * scale
                ax, ay, az, aw = s * ax + r * bx, s * ay + r * by, s * az + r * bz, s * aw + r * bw
        else:
            pose = edge.pose_at(time)
            if pose is None:
                assert isinstance(edge, History)
                pose = _along([edge.pair_around(time)], time)
            px, py, pz, ax, ay, az, aw = pose
        if composed:
            ux, uy, uz = (2.0 * (ay * z - az * y), 2.0 * (az * x - ax * z),
                          2.0 * (ax * y - ay * x))
            x, y, z = (px + x + aw * ux + ay * uz - az * uy, py + y + aw * uy + az * ux - ax * uz,
                       pz + z + aw * uz + ax * uy - ay * ux)
            qx, qy, qz, qw = (aw * qx + ax * qw + ay * qz - az * qy,
                              aw * qy + ay * qw + az * qx - ax * qz,
                              aw * qz + az * qw + ax * qy - ay * qx,
                              aw * qw - ax * qx - ay * qy - az * qz)
        else:
            x, y, z, qx, qy, qz, qw = px, py, pz, ax, ay, az, aw
            composed = True
    return x, y, z, qx, qy, qz, qw
