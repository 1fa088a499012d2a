"""The cost of lookups, and the memory of samples; by itself, only beside transform-tree."""

from collections.abc import Callable, Generator, Iterator
from functools import partial
import gc
from importlib.util import find_spec
from itertools import cycle
import math
from timeit import timeit
import tracemalloc
from typing import Any

import matplotlib.pyplot as plt
from measure import best, cost, has_real_tf2, Row
import numpy as np
from rclpy.duration import Duration
from rclpy.time import Time

from puretf import Buffer, Transform, TransformBuffer
from puretf._core.pose import Pose

S = 1_000_000_000
T = 1_700_000_000 * S
CACHE = Duration(seconds=1000)
MANY = 10_000


def pose(i: int, hertz: int) -> Pose:
    """Return sample i of a joint that waves."""
    angle = 0.7 * math.sin(0.5 * i / hertz)
    return 0.1, 0.2, 0.3, 0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2)


def fill(insert: Callable[..., object], edges: int, samples: int, hertz: int) -> int:
    """Insert a chain frame_0 → frame_1 → …; return the newest stamp (ns)."""
    for i in range(samples):
        for edge in range(edges):
            insert(T + i * S // hertz, f'frame_{edge}', f'frame_{edge + 1}', pose(i, hertz))
    return T + (samples - 1) * S // hertz


def rows(u: float) -> Iterator[Row]:
    """Measure lookups over five edges with 10 s of history at 1000 Hz, and its memory."""
    buffer = Buffer(CACHE)
    gc.collect()
    tracemalloc.start()
    newest = fill(buffer.insert, 5, 10_000, 1000)
    gc.collect()
    size = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    yield 'memory of a sample, 10 s at 1000 Hz', f'{size / 50_000:.0f} bytes', '', ''

    between = S // 3000  # so that every edge is interpolated
    reference = yield from lookup_rows(buffer, 'this package', newest - between, u)
    if has_real_tf2():
        import tf2_ros
        real = tf2_ros.Buffer(CACHE)

        def insert(stamp: int, parent: str, child: str, pose: Pose) -> None:
            real.set_transform(
                Transform(stamp, parent, child, pose[:3], pose[3:]).to_message(), 'bench')

        fill(insert, 5, 10_000, 1000)
        yield from lookup_rows(real, 'tf2_ros', newest - between, u)

    random = np.random.default_rng(1)
    anywhere = T + random.integers(0, newest - T, MANY)
    times = cycle([Time(nanoseconds=time) for time in anywhere.tolist()])
    seconds = best(lambda: buffer.lookup_transform('frame_0', 'frame_5', next(times)))
    yield ('another time for each call, any of the 10 s', *cost(seconds, u),
           f'{seconds / reference:.2f} of the newest')
    for name, asked in (('sorted', np.sort(anywhere)), ('not sorted', anywhere)):
        seconds = best(lambda: buffer.lookup_transforms(
            'frame_0', 'frame_5', asked)) / MANY  # noqa: B023
        yield (f'{MANY} lookups in one call, times {name}, each', *cost(seconds, u),
               f'{seconds / reference:.3f} of the newest')
    new = pose(0, 1000)
    message = Transform(T + 11 * S, 'frame_0', 'frame_1', new[:3], new[3:]).to_message()
    seconds = best(lambda: buffer.set_transform(message, 'bench'))
    yield 'set_transform', *cost(seconds, u), ''


def lookup_rows(buffer: Any, name: str, newest: int, u: float
                ) -> Generator[Row, None, float]:
    """Measure lookups in a filled buffer; return the time of one at the newest data (s)."""
    reference = 0.0
    for what, target, source, time in (
            ('newest data', 'frame_0', 'frame_5', newest),
            ('9 s old', 'frame_0', 'frame_5', newest - 9 * S),
            ('latest common time', 'frame_0', 'frame_5', 0),
            ('newest data, from parent to child', 'frame_5', 'frame_0', newest)):
        stamp = Time(nanoseconds=time)
        seconds = best(lambda: buffer.lookup_transform(target, source, stamp))  # noqa: B023
        reference = reference or seconds
        yield (f'{name}: lookup over 5 edges, {what}', *cost(seconds, u),
               f'{seconds / reference:.2f} of the newest')
    return reference


def beside_rust() -> Iterator[Row]:
    """
    Measure many lookups in one call, alternately with the Rust library transform-tree.

    The library interpolates as tf2 if it is told so; by default, it interpolates along a screw.
    The figures are the medians of eleven rounds. Without the library, there are no rows.
    """
    if find_spec('tf_tree') is None:
        return
    import tf_tree
    buffer = TransformBuffer(1000 * S)
    newest = fill(buffer.insert, 5, 10_000, 1000)
    anywhere = T + np.random.default_rng(1).integers(0, newest - T, MANY)
    edges = [(f'frame_{edge}', f'frame_{edge + 1}') for edge in range(5)]
    stamps = T + np.arange(10_000) * (S // 1000)
    samples = np.array([pose(i, 1000) for i in range(10_000)]).take([6, 3, 4, 5, 0, 1, 2], axis=1)
    for interp, what in ('lerpslerp', 'as tf2'), ('sclerp', 'its default'):
        tree = tf_tree.build(edges, capacity=1 << 14, interp=interp)
        for parent, child in edges:
            with tree.publisher(child, parent) as publisher:
                publisher.push_many(stamps, samples)
        plan = tree.plan('frame_0', 'frame_5')
        for name, asked in (('sorted', np.sort(anywhere)), ('not sorted', anywhere)):
            ours = partial(buffer.lookup_transforms, 'frame_0', 'frame_5', asked)
            theirs = partial(plan.at, asked, layout='quat')
            translations, rotations, _ = ours()
            # Rotations of less than 1e-7 rad differ: in tf2, the cosine is rounded to one.
            np.testing.assert_allclose(theirs(), np.hstack(
                (np.roll(rotations, 1, axis=1), translations)), rtol=0.0, atol=1e-7)
            rounds = np.array([[timeit(work, number=15) / 15 / MANY for work in (ours, theirs)]
                               for _ in range(11)])
            own, other = np.median(rounds, axis=0).tolist()
            ratios = rounds[:, 0] / rounds[:, 1]
            yield (f'{MANY} lookups in one call, times {name}, each', cost(own, 1.0)[0], '',
                   f'{np.median(ratios):.2f} ({ratios.min():.2f} to {ratios.max():.2f}) of '
                   f'transform-tree, interpolation {what}: {cost(other, 1.0)[0]}')


def costs(buffer: TransformBuffer, edges: int, newest: int) -> list[float]:
    """Return the times of lookups (µs): at the latest time, the last 10 samples, any time."""
    result = []
    for oldest in newest - 1, max(T, newest - S // 100), T:
        asked = np.random.default_rng(1).integers(oldest, newest, 1000)
        times = cycle([0] if oldest == newest - 1 else asked.tolist())
        result.append(1e6 * best(lambda: buffer.lookup_transform(
            'frame_0', f'frame_{edges}', next(times))))  # noqa: B023
    return result


def growth() -> Iterator[tuple[str, str, int, list[float]]]:
    """Measure how a lookup grows: yield what is fixed, what grows, its size, and the times."""
    for count in 10, 100, 1000, 10_000:
        buffer = TransformBuffer(1000 * S)
        newest = fill(buffer.insert, 5, 100, 1000)
        for i in range(count - 6):
            buffer.insert(T, f'frame_{i % 5}', f'other_{i}', pose(i, 1000))
        yield '5 edges, 100 samples', 'frames in the tree', count, costs(buffer, 5, newest)
    for count in 10, 100, 1000, 10_000, 100_000:
        buffer = TransformBuffer(1000 * S)
        newest = fill(buffer.insert, 5, count, 1000)
        yield '5 edges', 'samples in each history', count, costs(buffer, 5, newest)
    buffer = TransformBuffer(1000 * S)
    newest = fill(buffer.insert, 50, 100, 1000)
    for count in 1, 2, 5, 10, 20, 50:
        yield '100 samples', 'edges on the path', count, costs(buffer, count, newest)


def plot(path: str) -> None:
    """Draw how the cost of a lookup grows, and print it as a table."""
    print('\n| a lookup (µs) | | latest time | one of the last 10 samples | any time |')
    print('|---|---|---|---|---|')
    panels: dict[tuple[str, str], list[tuple[int, list[float]]]] = {}
    for fixed, growing, count, times in growth():
        panels.setdefault((fixed, growing), []).append((count, times))
        print(f'| {growing} | {count} | {" | ".join(f"{t:.1f}" for t in times)} |', flush=True)
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.5), layout='constrained')
    for axis, ((fixed, growing), points) in zip(axes, panels.items()):
        counts, measured = zip(*points)
        axis.plot(counts, measured, 'o-', label=('latest time', 'last 10 samples', 'any time'))
        axis.set(title=fixed, xlabel=growing, ylabel='one lookup (µs)')
        if growing != 'edges on the path':
            axis.set_xscale('log')
        axis.set_ylim(0, 1.2 * max(20.0, *map(max, measured)))
        axis.grid(visible=True, alpha=0.3)
    axes[0].legend()
    figure.savefig(path, dpi=100)


if __name__ == '__main__':
    for row in beside_rust():
        print(f'| {" | ".join(row)} |')
