"""The command `tf_trajectory`: write or draw the pose of a frame in another one over time."""

from argparse import Action
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
from io import BytesIO
from pathlib import Path
import sys
from typing import Any, Optional, TextIO
import warnings

import numpy as np
from numpy.typing import NDArray

from puretf import exact_time, SECOND, TransformException
from puretf._text.names import shortened, visible
from puretf.rotations import euler_from_quaternion
from puretf_tools.cli.bag_options import add_bag_options, BagOption
from puretf_tools.cli.files import path_to_write, whole_file
from puretf_tools.cli.parser import CommandError, frame_name, Parser, run, UsageError
from puretf_tools.cli.progress import listen, progress
from puretf_tools.cli.signals import check_signals, forget_signals
from puretf_tools.cli.times import seconds, When, when
from puretf_tools.inspection import gaps, recorded
from puretf_tools.inspection.bag_times import both, is_offset, why_outside
from puretf_tools.source import Source, source

#: The files that can be written.
TABLES, DRAWINGS = ('.csv', '.tum', '.npz'), ('.png', '.svg', '.pdf')
#: The interval over which --twist averages the velocity (ns).
TWIST_INTERVAL = SECOND // 10
#: The largest number of rows that --every may give.
MAX_ROWS = 10_000_000
#: The largest number of rows in a drawing. Of more rows, every second, third and so on is drawn.
MAX_DRAWN = 20_000
#: The number of rows that are looked up, or written, between two checks for a signal.
_PART = 8192

#: The columns of values, with the names of CSV files.
POSE = ('x_m', 'y_m', 'z_m', 'qx', 'qy', 'qz', 'qw', 'roll_rad', 'pitch_rad', 'yaw_rad')
TWIST = ('vx_m_s', 'vy_m_s', 'vz_m_s', 'wx_rad_s', 'wy_rad_s', 'wz_rad_s')
#: The arrays of .npz files: their names and their columns.
ARRAYS = {'positions': slice(0, 3), 'quaternions': slice(3, 7), 'rpy': slice(7, 10),
          'linear': slice(10, 13), 'angular': slice(13, 16)}


class Trajectory:
    """The poses of a source frame in a target frame at increasing times."""

    def __init__(self, found: Source, ends: tuple[str, str], edges: gaps.Edges,
                 times: NDArray[np.int64], has_twist: bool, max_gap: Optional[int]) -> None:
        """
        Look up the poses.

        :param ends: the target frame and the source frame.
        :param edges: those between the two, from `path_edges`.
        :param times: (n,) times (ns).
        :raises CommandError: if no time has a transform.
        """
        self.ends, self.times, self.has_twist = ends, times, has_twist
        self._found, self._edges, self._max_gap = found, edges, max_gap
        #: (n, 10) or, with a twist, (n, 16); NaN: there is no row.
        self.values = np.full((len(times), len(POSE) + len(TWIST) * has_twist), np.nan)
        with progress(len(times), desc='looking up',
                      bar_format='{desc} {bar} {n} of {total} rows') as show_progress:
            for begin in range(0, len(times), _PART):
                self._look_up(times[begin:begin + _PART], self.values[begin:begin + _PART])
                show_progress(min(begin + _PART, len(times)))
        self.values[~np.isfinite(self.values).all(axis=1) | (times == 0)] = np.nan
        self._missing = times[~self.known]
        holes = gaps.holes_at(edges, times, max_gap)
        is_in_hole = self.known & holes.astype(np.bool_)
        self._holes = holes[is_in_hole].tolist()  #: those that rows are in
        if max_gap is not None:
            self.values[is_in_hole] = np.nan
        self.stamps = times[self.known]  #: those of the rows
        if not len(self.stamps):
            raise CommandError(f'there is no row: {"; ".join(self.remarks())}')
        self.values[self.known, 3:7] = _without_flips(self.values[self.known, 3:7])

    @property
    def known(self) -> NDArray[np.bool_]:
        return np.asarray(~np.isnan(self.values[:, 0]))

    def rows_after_holes(self) -> NDArray[np.int64]:
        """Return which rows have a hole in the data between them and the row before."""
        between = self.times[:-1] + np.diff(self.times) // 2
        holes = gaps.holes_at(self._edges, between, self._max_gap)
        return np.flatnonzero(holes.astype(np.bool_)) + 1

    def _look_up(self, times: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        buffer = self._found.buffer
        values[:, :3], values[:, 3:7], known = buffer.lookup_transforms(*self.ends, times)
        for i in np.flatnonzero(known).tolist():
            values[i, 7:10] = euler_from_quaternion(values[i, 3:7].tolist())
            if self.has_twist:
                with suppress(TransformException):
                    values[i, 10:] = np.ravel(self._twist(int(times[i])))

    def __str__(self) -> str:
        count, begin, end = len(self.stamps), *map(exact_time, self.stamps[[0, -1]])
        return f'{count} row{"s" * (count > 1)} from {begin} s to {end} s'

    def remarks(self) -> Iterator[str]:
        """Yield a line for each reason why rows are left out, or may be wrong."""
        dated = self._missing[self._missing != 0]
        is_beyond, data = gaps.beyond_ends(self._edges, dated)
        others = np.setdiff1d(self._missing, dated[is_beyond])
        if is_beyond.any():
            yield f'{self._some(int(is_beyond.sum()), "stamp")} outside the data of {data}'
        if len(others):
            yield (f'{self._some(len(others), "row")} left out, without a transform'
                   f'{" or a velocity" * self.has_twist}; the first, at {exact_time(others[0])} '
                   f's: {self._why_not(int(others[0]))}')
        if count := len(self._holes):
            hole = max(self._holes, key=lambda each: each.end - each.begin)
            what = 'interpolated over' if self._max_gap is None else 'left out, in'
            zero = None if self._found.listener else self._found.span[0]
            yield (f'{count} row{"s are" if count > 1 else " is"} {what} gaps without data; in '
                   f'the longest, {hole.edge} has none {hole.between(zero)}')

    def _some(self, count: int, what: str) -> str:
        return f'{count} of {len(self.times)} {what}s {"is" if count == 1 else "are"}'

    def _twist(self, time: int) -> Any:
        return self._found.buffer.lookup_twist(*self.ends, time, TWIST_INTERVAL)

    def _why_not(self, time: int) -> str:
        if not time:
            return ('the stamp is 0, and a lookup for time 0 returns the latest transform: set '
                    'the stamps')
        if why := self._found.buffer.why_not(*self.ends, time):
            return why
        if self.has_twist:
            try:
                self._twist(time)
            except TransformException as error:
                return f'there is no velocity: {error}'
        return 'a number is too large for a float64'


def _without_flips(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Choose the sign of each quaternion but the first, (n, 4), by the one before."""
    is_flip = (quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0.0
    signs = np.cumprod(np.where(is_flip, -1.0, 1.0))
    quaternions[1:] *= signs[:, None]
    return quaternions + 0.0  # no -0.0


def command(target_frame: Optional[str], source_frame: Optional[str], output: Optional[str],
            every: Optional[int], at: Optional[str], start: Optional[When], stop: Optional[When],
            max_gap: Optional[int], twist: bool, topic: Optional[str], seconds: float,
            bag: Optional[BagOption], namespace: str, ros_args: Sequence[str]) -> int:
    """
    Write or draw the poses of the source frame in the target frame over time.

    :param output: None: print the table in CSV.
    :param every: the interval between two rows (ns), from the first time on at which a row is
        possible; None: a row for each stamp of the dynamic transforms between the two frames.
    :param max_gap: the longest step of an edge over which poses are interpolated (ns).
    """
    frames = [name for name in (target_frame, source_frame) if name]
    for is_wrong, why in (
            (not bag and (start or stop or at or topic),
             '--start, --stop, --at and --topic need --bag'),
            (every == 0, '--every must be more than 0 s'),
            (at and every, 'give either --at or --every'),
            (topic and (frames or at), 'with --topic, leave out the frames and --at')):
        if is_wrong:
            raise UsageError(why)
    path = None if output is None else _output_path(output, twist)
    reader = recorded.PathReader(frames, at, topic)
    with source('tf_trajectory', bag, namespace, ros_args, seconds, reader.read) as found:
        if found.listener:  # a signal ends the recording
            listen(seconds, found.buffer.frame_names)
        ends = reader.frames[0], reader.frames[1]
        try:
            edges = found.buffer.path_edges(*ends)
        except TransformException as error:
            raise CommandError(found.why_not(*ends) or str(error)) from None
    if found.listener:
        forget_signals()  # another one ends the command
    stamps = _stamps(found, *ends) if reader.stamps is None else reader.stamps
    if every is not None:  # from the first time on at which a row is possible
        is_beyond, _ = gaps.beyond_ends(edges, stamps)
        first = stamps[is_beyond.argmin()] + twist * TWIST_INTERVAL // 2
        stamps = np.append(min(first, stamps.max()), stamps[stamps > first])
    times = _times(stamps, found.span, every, start, stop)
    is_drawing = path is not None and path.suffix.lower() in DRAWINGS
    step = -(-len(times) // MAX_DRAWN) if is_drawing else 1
    trajectory = Trajectory(found, ends, edges, times[::step], twist, max_gap)
    if path is None:
        _write_csv(sys.stdout, trajectory)
        print(f'tf_trajectory: {trajectory}', file=sys.stderr)
    else:
        with whole_file(path) as part:
            _write(part, path.suffix.lower(), trajectory, step)
            check_signals()
        some = f', of {len(times)} rows one of {step}' if step > 1 else ''
        print(f'wrote {visible(str(path))}: {trajectory}{some}')
    for remark in trajectory.remarks():
        print(f'tf_trajectory: {visible(remark)}', file=sys.stderr)
    return 0


def _output_path(output: str, twist: bool) -> Path:
    """Return the path of a file, after a check that it can be written in its format."""
    path = path_to_write(output, (*TABLES, *DRAWINGS))
    ending = path.suffix.lower()
    if twist and ending == '.tum':
        raise UsageError('a .tum file has no place for velocities: leave out --twist, or write '
                         f'another format than {output!r}')
    if ending in DRAWINGS:
        try:
            import matplotlib.figure  # noqa: F401
        except ImportError as error:
            raise CommandError(f'drawing needs matplotlib, which cannot be imported ({error}): '
                               'pip install matplotlib; or with ROS on Ubuntu: apt install '
                               'python3-matplotlib') from None
    return path


def _stamps(found: Source, target: str, source_frame: str) -> NDArray[np.int64]:
    """Return the stamps of a path (ns); raise a CommandError if there are none."""
    stamps = found.buffer.path_stamps(target, source_frame)
    if not len(stamps):
        raise CommandError('both frames are the same' if target == source_frame else
                           f'{source_frame!r} never moves in {target!r}: there is no dynamic '
                           'transform between them. Print its pose with tf2_echo')
    return stamps


def _times(stamps: NDArray[np.int64], span: tuple[int, int], every: Optional[int],
           start: Optional[When], stop: Optional[When]) -> NDArray[np.int64]:
    """Return the times (ns) of the rows: stamps, or times at equal distances `every` (ns)."""
    first, last = int(stamps[0]), int(stamps[-1])
    low = start.within(span) if start else first
    high = stop.within(span) if stop else last
    for time in low, high:
        if is_offset(time, span):
            raise UsageError(why_outside(time, span))
    if start and stop and low > high:
        raise UsageError('--start must not be after --stop')
    first, last = max(first, low), min(last, high)
    if every is not None:
        count = max(0, (last - first) // every + 1)
        if count > MAX_ROWS:
            raise UsageError(f'--every {every / SECOND:g} would give {count} rows, and at most '
                             f'{MAX_ROWS} are possible: choose at least '
                             f'{1.1 * (last - first) / MAX_ROWS / SECOND:.2g} s')
        stamps = min(first, last) + every * np.arange(count, dtype=np.int64)
    stamps = stamps[(stamps >= first) & (stamps <= last)]
    if not len(stamps):
        begin, end = span
        raise CommandError(
            f'there is no row in this time: the bag is from {exact_time(begin)} to '
            f'{both(end, begin)}')
    return stamps


def _write(path: Path, ending: str, trajectory: Trajectory, step: int) -> None:
    """Write a file; for the title of a drawing, one of `step` rows is drawn."""
    if ending in DRAWINGS:
        _draw(path, ending, trajectory, step)
    elif ending == '.npz':
        values = trajectory.values[trajectory.known]
        arrays: dict[str, Any] = {name: values[:, columns] for name, columns in ARRAYS.items()
                                  if columns.stop <= values.shape[1]}
        with open(path, 'wb') as array_file:
            np.savez(array_file, stamps=trajectory.stamps, **arrays)
    else:
        with open(path, 'w', encoding='utf-8', newline='') as file:
            if ending == '.csv':
                _write_csv(file, trajectory)
            else:
                file.writelines(f'{exact_time(stamp)} {" ".join(map(repr, row[:7]))}\n'
                                for stamp, row in _rows(trajectory))


def _write_csv(file: TextIO, trajectory: Trajectory) -> None:
    file.write(','.join(('stamp_ns', *POSE, *(TWIST if trajectory.has_twist else ()))) + '\n')
    file.writelines(f'{stamp},{",".join(map(repr, row))}\n' for stamp, row in _rows(trajectory))


def _rows(trajectory: Trajectory) -> Iterator[tuple[int, list[float]]]:
    """Yield the stamp (ns) and the values of each row; part by part, since lists are large."""
    known = np.flatnonzero(trajectory.known)
    for begin in range(0, len(known), _PART):
        part = known[begin:begin + _PART]
        yield from zip(trajectory.times[part].tolist(), trajectory.values[part].tolist())
        check_signals()


def _draw(path: Path, ending: str, trajectory: Trajectory, step: int) -> None:
    from matplotlib.figure import Figure
    values, begin = trajectory.values, trajectory.stamps[0]
    times, holes = (trajectory.times - begin) / SECOND, trajectory.rows_after_holes()
    style: dict[str, Any] = {
        'linewidth': 1.2, 'marker': '.' if len(trajectory.stamps) < 100 else ''}
    panels = [('position (m)', 'xyz', values[:, :3]),
              ('angle (°)', ('roll', 'pitch', 'yaw'), np.degrees(values[:, 7:10])),
              ('velocity (m/s)', 'xyz', values[:, 10:13]),
              ('angular velocity\n(rad/s)', 'xyz', values[:, 13:])]
    panels = panels if trajectory.has_twist else panels[:2]
    figure = Figure(figsize=(11.0, 1.0 + 2.1 * len(panels)), layout='constrained')
    ((left, right),) = figure.subfigures(1, 2, squeeze=False, width_ratios=(3, 2))
    rows = left.subplots(len(panels), 1, sharex=True)
    for axes, (label, names, columns) in zip(rows, panels):
        for name, column in zip(names, columns.T):
            longest = 180.0 if label.startswith('angle') else np.inf
            _plot(axes, times, column, holes, longest, label=name, **style)
        axes.set_ylabel(label)
        axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), frameon=False)
    rows[-1].set_xlabel(f'time (s), from {exact_time(begin)} s')
    left.align_ylabels()
    _plot_path(right.subplots(), values[:, 0], values[:, 1], holes, style)
    for axes in figure.axes:
        axes.ticklabel_format(useOffset=False)
        axes.grid(alpha=0.3)
    names = ' in '.join(map(shortened, trajectory.ends[::-1]))
    figure.suptitle(f'{names}{f", one of {step} rows" * (step > 1)}', parse_math=False)
    # Where a file cannot be written, the PDF backend raises other errors than OSError.
    drawing = BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # names may have characters that the font does not have
        figure.savefig(drawing, format=ending[1:], dpi=110)
    path.write_bytes(drawing.getvalue())


def _plot_path(axes: Any, x: NDArray[np.float64], y: NDArray[np.float64],
               holes: NDArray[np.int64], style: dict[str, Any]) -> None:
    _plot(axes, x, y, holes, dashes='no data', color='black', **style)
    for i, marker, color, label in ((0, 'o', 'tab:green', 'start'), (-1, 's', 'tab:red', 'end')):
        row = np.flatnonzero(~np.isnan(x))[i]
        axes.plot(x[row], y[row], marker, color=color, label=label)
    axes.set_aspect('equal', adjustable='datalim')
    axes.set(xlabel='x (m)', ylabel='y (m)', title='path from above')
    axes.legend()


def _plot(axes: Any, x: NDArray[np.float64], y: NDArray[np.float64], holes: NDArray[np.int64],
          longest: float = np.inf, dashes: Optional[str] = None, **style: Any) -> None:
    """Draw a line, dashed before some rows, with a gap where an angle jumps by 360 degrees."""
    jumps = np.flatnonzero(abs(np.diff(y)) > longest) + 1
    (line,) = axes.plot(*(np.insert(each, np.union1d(jumps, holes), np.nan) for each in (x, y)),
                        **style)
    if len(holes):
        axes.plot(*(np.insert(each, jumps, np.nan) for each in (x, y)), '--', label=dashes,
                  color=line.get_color(), linewidth=0.8)


def main(args: Optional[Sequence[str]] = None) -> int:
    parser = Parser(
        'tf_trajectory', 'Write or draw the pose of source_frame in target_frame over time: a row '
        'for each stamp of the dynamic transforms between the two frames.',
        'examples: tf_trajectory map end_effector --time 20 -o arm.csv\n'
        '          tf_trajectory map end_effector --every 0.1 -o arm.png\n'
        '          tf_trajectory --bag robot.mcap map base_link -o robot.tum\n'
        '          tf_trajectory --bag robot.mcap map base_link --twist -o robot.npz\n'
        '          tf_trajectory --bag robot.mcap map base_link --at /scan --start +9 -o at.csv\n'
        '          tf_trajectory --bag robot.mcap --topic /odom -o odom.tum')
    frames = [parser.add_argument(name, type=frame_name)
              for name in ('target_frame', 'source_frame')]

    def topic(text: str, optional: Sequence[Action] = ()) -> str:
        """Convert the name of a topic; with its option, some frames may be left out."""
        for frame in optional:
            frame.required = False
        return f'/{text.strip("/")}'

    parser.add_argument('-o', '--output', metavar='FILE',
                        help='the file: a table (.csv, .npz, or .tum, which evo reads), or a '
                             'drawing (.png, .svg, .pdf); default: print the table in CSV')
    parser.add_argument('--every', type=seconds, metavar='SECONDS',
                        help='the interval between two rows (s; default: a row for each stamp)')
    parser.add_argument('--at', type=partial(topic, optional=frames[1:]), metavar='TOPIC',
                        help='with --bag: a row for the stamp of each message on a topic; if only '
                             'one frame is given, target_frame is the frame_id of the messages')
    for name, what in ('start', 'first'), ('stop', 'last'):
        parser.add_argument(f'--{name}', type=when, metavar='TIME',
                            help=f'with --bag: the time of the {what} row: a stamp (s), +12.5 (s '
                                 'after the first transform), -1.5 (before the last), or '
                                 '2025-10-09T08:53:32Z')
    parser.add_argument('--max-gap', type=seconds, metavar='SECONDS',
                        help='no rows where a transform is interpolated over a longer time (s)')
    parser.add_argument('--topic', type=partial(topic, optional=frames),
                        help='with --bag, in place of the frames: the poses on a topic of '
                             f'{", ".join(recorded.POSES)}')
    parser.add_argument('--twist', action='store_true',
                        help='add the velocity of the origin of source_frame and its angular '
                             'velocity, both in the axes of target_frame, averaged over '
                             f'{TWIST_INTERVAL / SECOND:g} s')
    add_bag_options(parser, '--time')
    return run(parser, command, args)
