"""The command `tf_trajectory`: write or draw the pose of a frame in another one over time."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from io import BytesIO
from math import pi, tau
import os
from pathlib import Path
from shutil import copyfileobj
import sys
from tempfile import TemporaryFile
from typing import Any, Optional, TextIO, TYPE_CHECKING, Union
import warnings
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from puretf import exact_time, SECOND, shortened, TransformBuffer, TransformException, visible
from puretf_tools.cli.bag_options import add_bag_options, read_bag
from puretf_tools.cli.files import path_to_write, whole_file
from puretf_tools.cli.parser import CommandError, number, Parser, run, UsageError
from puretf_tools.cli.progress import DEFAULT_TIME, listen, listening_time, progress
from puretf_tools.cli.signals import check_signals, forget_signals
from puretf_tools.inspection.terminal import is_terminal

if TYPE_CHECKING:
    from puretf import BufferCore

#: The files that can be written.
TABLES, DRAWINGS = ('.csv', '.tum', '.npz'), ('.png', '.svg', '.pdf')
#: The interval over which --twist averages the velocity (ns).
TWIST_INTERVAL = SECOND // 10
#: The largest number of rows that --every may give.
MAX_ROWS = 10_000_000
#: The largest number of rows in a drawing. Of more rows, every second, third and so on is drawn.
MAX_DRAWN = 20_000
#: The largest number in a drawing; matplotlib fails or does not end near the limit of float64.
LARGEST_DRAWN = 1e300
#: The buffer keeps transforms for this time more than the command listens (s).
_MARGIN = 5.0
#: The number of rows that are looked up before they are written.
_PART = 8192
#: Near gimbal lock, a norm below this number is an error by rounding.
_ROUNDING = 4.0 * np.finfo(np.float64).eps

#: The columns of values, with the names of CSV files.
POSE = ('x_m', 'y_m', 'z_m', 'qx', 'qy', 'qz', 'qw', 'roll_rad', 'pitch_rad', 'yaw_rad')
TWIST = ('vx_m_s', 'vy_m_s', 'vz_m_s', 'wx_rad_s', 'wy_rad_s', 'wz_rad_s')
#: The arrays of .npz files: their names and their columns.
ARRAYS = {'positions': slice(0, 3), 'quaternions': slice(3, 7), 'rpy': slice(7, 10),
          'linear': slice(10, 13), 'angular': slice(13, 16)}

AnyBuffer = Union[TransformBuffer, 'BufferCore']
#: Stamps, (n,) int64 (ns), and values, (n, 10) or, with a twist, (n, 16) float64.
Rows = tuple[NDArray[np.int64], NDArray[np.float64]]


class Trajectory:
    """The poses of a source frame in a target frame at increasing times (ns)."""

    def __init__(self, buffer: AnyBuffer, target: str, source: str, times: NDArray[np.int64],
                 has_twist: bool, has_bar: bool = True) -> None:
        self.target, self.source, self.times, self.has_twist = target, source, times, has_twist
        self._buffer, self._has_bar = buffer, has_bar
        #: The number of rows so far, and the stamps of the first and the last of them (ns).
        self.count = self.begin = self.end = 0
        #: The number of times left out so far, the first of them (ns), and why it was left out.
        self.left_out = self.first_left_out = 0
        self.reason = ''

    def parts(self) -> Iterator[Rows]:
        """
        Look up the poses part by part; times without a transform have rows of NaN.

        :raises CommandError: if no time has a transform.
        """
        with progress(len(self.times), desc='looking up', disable=None if self._has_bar else True,
                      bar_format='{desc} {bar} {n} of {total} rows') as show_progress:
            for begin in range(0, len(self.times), _PART):
                times = self.times[begin:begin + _PART]
                yield self._part(times)
                show_progress(begin + len(times))
        if not self.count:
            raise CommandError(
                f'no row has a transform{" and a velocity" * self.has_twist}; the first of '
                f'{self.left_out}, at {exact_time(self.first_left_out)} s: {self.reason}')

    def rows(self) -> Iterator[Rows]:
        """Look up the poses as `parts`, without the rows of NaN."""
        for stamps, values in self.parts():
            known = ~np.isnan(values[:, 0])
            if known.any():
                yield stamps[known], values[known]

    def _part(self, times: NDArray[np.int64]) -> Rows:
        positions, quaternions, known = self._buffer.lookup_transforms(
            self.target, self.source, times)
        known &= times != 0  # these are the latest poses
        columns = [positions, quaternions, roll_pitch_yaw(quaternions)]
        if self.has_twist:
            columns.append(np.full((len(times), len(TWIST)), np.nan))
            for i in np.flatnonzero(known).tolist():
                with suppress(TransformException):
                    columns[-1][i] = np.ravel(self._twist(int(times[i])))
        values = np.hstack(columns)
        known &= np.isfinite(values).all(axis=1)
        values[~known] = np.nan
        present, missing = times[known].tolist(), times[~known].tolist()
        if present:
            self.begin = self.begin if self.count else present[0]
            self.end = present[-1]
        if missing and not self.left_out:
            self.first_left_out, self.reason = missing[0], self._why_not(missing[0])
        self.count += len(present)
        self.left_out += len(missing)
        return times, values

    def _twist(self, time: int) -> Any:
        return self._buffer.lookup_twist(self.target, self.source, time, TWIST_INTERVAL)

    def _why_not(self, time: int) -> str:
        """Return why the row of a time (ns) is left out."""
        if not time:
            return ('the stamp is 0, and a lookup for time 0 returns the latest transform: set '
                    'the stamps')
        if why := self._buffer.why_not(self.target, self.source, time):
            return why
        if self.has_twist:
            try:
                self._twist(time)
            except TransformException as error:
                return f'there is no velocity: {error}'
        return 'a number is too large for a float64'


def roll_pitch_yaw(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Convert many quaternions as `euler_from_quaternion` converts one.

    :param quaternions: (n, 4): x, y, z, w, of length 1 or NaN.
    :returns: (n, 3): the angles about the fixed axes x, y and z (rad).
    """
    x, y, z, w = quaternions.T
    a, b, c, d = w - y, x + z, w + y, z - x
    sum_norm, difference_norm = np.hypot(a, b), np.hypot(c, d)
    half_sum, half_difference = np.arctan2(b, a), np.arctan2(d, c)
    half_sum, half_difference = (np.where(sum_norm < _ROUNDING, -half_difference, half_sum),
                                 np.where(difference_norm < _ROUNDING, -half_sum, half_difference))
    pitch = 2.0 * np.arctan2(difference_norm, sum_norm) - pi / 2.0
    angles = np.stack((half_sum - half_difference, pitch, half_sum + half_difference), axis=1)
    # The rest of the division by a whole turn is in (-pi, pi]; adding 0.0 turns -0.0 into 0.0.
    wrapped: NDArray[np.float64] = angles - tau * np.ceil(angles / tau - 0.5) + 0.0
    return wrapped


def command(target_frame: str, source_frame: str, output: Optional[str] = None,
            every: Optional[float] = None, twist: bool = False, seconds: Optional[float] = None,
            bag: Optional[Sequence[str]] = None, namespace: str = '', partial: bool = False, *,
            ros_args: Sequence[str] = ()) -> int:
    """
    Write or draw the poses of the source frame in the target frame over time.

    :param output: path of the file. Its ending gives the format; see `TABLES` and `DRAWINGS`.
        None: print the table in CSV.
    :param every: the interval between two rows (s), counted from the first stamp; None: a row for
        each stamp of the dynamic transforms between the two frames.
    :param seconds: how long to listen (s); None: 5 s.
    """
    target, source = (name.removeprefix('/') for name in (target_frame, source_frame))
    if not target or not source:
        raise UsageError('a frame must have a name')
    if seconds is not None and bag is not None:
        raise UsageError('--time is for listening: leave it out with --bag')
    seconds = listening_time(seconds)
    if every is not None and not 1 <= every * SECOND < 2**63:
        raise UsageError(f'--every must be at least 1e-09 s, and less than 9.2e+09 s, got '
                         f'{every:g}')
    path = None if output is None else _output_path(output, twist)
    buffer = (read_bag(bag, namespace, partial)
              or _record(target, source, seconds, namespace, ros_args))
    times = _times(buffer, target, source, every)
    is_drawing = path is not None and path.suffix.lower() in DRAWINGS
    step = -(-len(times) // MAX_DRAWN) if is_drawing else 1
    # There is no bar within a table on the terminal.
    trajectory = Trajectory(buffer, target, source, times[::step], twist,
                            has_bar=path is not None or not is_terminal())
    if path is None:
        _write_csv(sys.stdout, trajectory.rows(), twist)
    else:
        with whole_file(path) as part:
            _write(part, path.suffix.lower(), trajectory, step)
            check_signals()
    _print_summary(trajectory, path, f', of {len(times)} rows one of {step}' * (step > 1))
    return 0


def _print_summary(trajectory: Trajectory, path: Optional[Path], some: str) -> None:
    rows = '1 row' if trajectory.count == 1 else f'{trajectory.count} rows'
    summary = (f'{rows} from {exact_time(trajectory.begin)} s to {exact_time(trajectory.end)} s'
               f'{some}')
    if path is None:
        print(f'tf_trajectory: {summary}', file=sys.stderr)
    else:
        print(f'wrote {visible(str(path))}: {summary}')
    if left_out := trajectory.left_out:
        velocity = ' or a velocity' if trajectory.has_twist else ''
        print(f'tf_trajectory: {left_out} of {len(trajectory.times)} rows '
              f'{"are" if left_out > 1 else "is"} left out, without a transform{velocity}; the '
              f'first, at {exact_time(trajectory.first_left_out)} s: {visible(trajectory.reason)}',
              file=sys.stderr)


def _output_path(output: str, twist: bool) -> Path:
    """Return the path of a file, after a check that it can be written in its format."""
    path = path_to_write(output, (*TABLES, *DRAWINGS))
    ending = path.suffix.lower()
    if twist and ending == '.tum':
        raise UsageError('a .tum file has no place for velocities: leave out --twist, or write '
                         f'another format than {output!r}')
    if ending in DRAWINGS:
        os.environ['MPLBACKEND'] = 'agg'  # another one might be missing, and no window is opened
        try:
            from matplotlib.backend_bases import get_registered_canvas_class
            import matplotlib.figure  # noqa: F401
            get_registered_canvas_class(ending[1:])
        except ImportError as error:
            raise CommandError(f'drawing needs matplotlib, which cannot be imported ({error}): '
                               'pip install matplotlib; or with ROS on Ubuntu: apt install '
                               'python3-matplotlib') from None
    return path


def _record(target: str, source: str, seconds: float, namespace: str, ros_args: Sequence[str]
            ) -> 'BufferCore':
    """Listen for some time, or until Ctrl-C or SIGTERM; the two frames must be connected then."""
    from puretf_tools.cli.node import spinning_node
    from puretf_tools.inspection.frame_listener import FrameListener
    with spinning_node('tf_trajectory', ros_args, namespace) as node:
        frame_listener = FrameListener(node, seconds + _MARGIN)
        buffer: BufferCore = frame_listener.buffer
        listen(seconds, buffer.frame_names)
        try:
            buffer.path_stamps(target, source)
        except TransformException as error:
            why = frame_listener.why_no_transform(target, source)
            raise CommandError(why or str(error)) from None
    forget_signals()  # the first Ctrl-C has ended the recording; another one ends the command
    return buffer


def _times(buffer: AnyBuffer, target: str, source: str, every: Optional[float]
           ) -> NDArray[np.int64]:
    """Return the times (ns) of the rows: the stamps, or times at equal distances `every` (s)."""
    try:
        stamps = buffer.path_stamps(target, source)
    except TransformException as error:
        raise CommandError(str(error)) from None
    if not len(stamps):
        raise CommandError('both frames are the same' if target == source else
                           f'{source!r} never moves in {target!r}: there is no dynamic transform '
                           'between them. Print its pose with tf2_echo')
    if every is None:
        return stamps
    first, last = int(stamps[0]), int(stamps[-1])
    period = round(every * SECOND)
    count = (last - first) // period + 1
    if count > MAX_ROWS:
        raise UsageError(f'--every {every:g} would give {count} rows, and at most {MAX_ROWS} are '
                         f'possible: choose at least '
                         f'{1.05 * (last - first) / MAX_ROWS / SECOND:.2g} s')
    return first + period * np.arange(count, dtype=np.int64)


def _write(path: Path, ending: str, trajectory: Trajectory, step: int) -> None:
    """Write a file; for the title of a drawing, one of `step` rows is drawn."""
    if ending in DRAWINGS:
        _draw(path, ending, trajectory, step)
    elif ending == '.npz':
        _write_npz(path, trajectory.rows(), trajectory.has_twist)
    else:
        with open(path, 'w', encoding='utf-8', newline='') as file:
            if ending == '.csv':
                _write_csv(file, trajectory.rows(), trajectory.has_twist)
            else:
                _write_tum(file, trajectory.rows())


def _write_csv(file: TextIO, rows: Iterable[Rows], has_twist: bool) -> None:
    header = ','.join(('stamp_ns', *POSE, *(TWIST if has_twist else ()))) + '\n'
    for stamps, values in rows:
        file.write(header + ''.join(
            f'{stamp},{",".join(map(repr, row))}\n'
            for stamp, row in zip(stamps.tolist(), values.tolist())))
        header = ''


def _write_tum(file: TextIO, rows: Iterable[Rows]) -> None:
    for stamps, values in rows:
        file.write(''.join(
            f'{exact_time(stamp)} {" ".join(map(repr, row))}\n'
            for stamp, row in zip(stamps.tolist(), values[:, :7].tolist())))


def _write_npz(path: Path, rows: Iterable[Rows], has_twist: bool) -> None:
    """Write the arrays of all rows; until the number of rows is known, to temporary files."""
    names = ('stamps', *ARRAYS) if has_twist else ('stamps', *ARRAYS)[:4]
    count = 0
    with ExitStack() as stack:
        files = {name: stack.enter_context(TemporaryFile(dir=path.parent)) for name in names}
        for stamps, values in rows:
            count += len(stamps)
            for name, file in files.items():
                file.write((stamps if name == 'stamps' else values[:, ARRAYS[name]]).tobytes())
        archive = stack.enter_context(ZipFile(path, 'w'))
        for name, file in files.items():
            check_signals()
            file.seek(0)
            with archive.open(f'{name}.npy', 'w', force_zip64=True) as member:
                np.lib.format.write_array_header_1_0(member, {
                    'descr': '<i8' if name == 'stamps' else '<f8', 'fortran_order': False,
                    'shape': (count,) if name == 'stamps' else (
                        count, values[:, ARRAYS[name]].shape[1])})
                copyfileobj(file, member)


def _draw(path: Path, ending: str, trajectory: Trajectory, step: int) -> None:
    """Draw positions, angles and velocities over time, and the path from above."""
    from matplotlib.figure import Figure
    stamps, values = (np.concatenate(each) for each in zip(*trajectory.parts()))
    if (too_large := np.argwhere(abs(values) > LARGEST_DRAWN)).size:
        row, column = too_large[0]
        raise CommandError(
            f'the pose of {trajectory.source!r} in {trajectory.target!r} is too large to draw: '
            f'{(*POSE, *TWIST)[column]} is {values[row, column]:g} at {exact_time(stamps[row])} '
            f's, and the limit is {LARGEST_DRAWN:g}. Write a table ({", ".join(TABLES)})')
    style = {'linewidth': 1.2, 'marker': '.' if trajectory.count < 100 else ''}
    panels = 4 if trajectory.has_twist else 2
    figure = Figure(figsize=(11.0, 1.0 + 2.1 * panels), layout='constrained')
    grid = figure.add_gridspec(panels, 2, width_ratios=(3, 2))
    rows = [figure.add_subplot(grid[0, 0])]
    rows += [figure.add_subplot(grid[i, 0], sharex=rows[0]) for i in range(1, panels)]
    _plot_over_time(rows, (stamps - trajectory.begin) / SECOND, values, style)
    rows[-1].set_xlabel(f'time (s), from {exact_time(trajectory.begin)} s')
    figure.align_ylabels()
    _plot_path(figure.add_subplot(grid[:, 1]), values[:, 0], values[:, 1], style)
    some = f', one of {step} rows' if step > 1 else ''
    figure.suptitle(f'{shortened(trajectory.source)} in {shortened(trajectory.target)}{some}',
                    parse_math=False)
    # Where a file cannot be written, the PDF backend raises other errors than OSError.
    drawing = BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # names may have characters that the font does not have
        figure.savefig(drawing, format=ending[1:], dpi=110)
    path.write_bytes(drawing.getvalue())


def _plot_over_time(rows: list[Any], times: NDArray[np.float64], values: NDArray[np.float64],
                    style: dict[str, Any]) -> None:
    """Plot three columns of values in each of the axes, which share the time (s)."""
    for axes, (label, names, array) in zip(rows, (
            ('position (m)', 'xyz', 'positions'), ('angle (°)', ('roll', 'pitch', 'yaw'), 'rpy'),
            ('velocity (m/s)', 'xyz', 'linear'),
            ('angular velocity\n(rad/s)', 'xyz', 'angular'))):
        for name, column in zip(names, values[:, ARRAYS[array]].T):
            x, y = (_without_jumps(times, np.degrees(column)) if array == 'rpy' else
                    (times, column))
            axes.plot(x, y, label=name, **style)
        axes.set_ylabel(label)
        axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), frameon=False)
        axes.tick_params(labelbottom=axes is rows[-1])
        axes.ticklabel_format(useOffset=False)
        axes.grid(alpha=0.3)


def _plot_path(axes: Any, x: NDArray[np.float64], y: NDArray[np.float64], style: dict[str, Any]
               ) -> None:
    axes.plot(x, y, color='black', **style)
    for i, marker, color, label in ((0, 'o', 'tab:green', 'start'), (-1, 's', 'tab:red', 'end')):
        row = np.flatnonzero(~np.isnan(x))[i]
        axes.plot(x[row], y[row], marker, color=color, label=label)
    axes.set_aspect('equal', adjustable='datalim')
    axes.set(xlabel='x (m)', ylabel='y (m)', title='path from above')
    axes.ticklabel_format(useOffset=False)
    axes.legend()
    axes.grid(alpha=0.3)


def _without_jumps(times: NDArray[np.float64], angles: NDArray[np.float64]
                   ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Insert NaN where an angle jumps from 180 to -180 degrees, or back."""
    jumps = np.flatnonzero(abs(np.diff(angles)) > 180.0) + 1
    return np.insert(times, jumps, np.nan), np.insert(angles, jumps, np.nan)


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command; see `--help`."""
    parser = Parser(
        'tf_trajectory', 'Write or draw the pose of source_frame in target_frame over time: a row '
        'for each stamp of the dynamic transforms between the two frames.',
        'examples: tf_trajectory map end_effector --time 20 -o arm.csv\n'
        '          tf_trajectory map end_effector --every 0.1 -o arm.png\n'
        '          tf_trajectory --bag robot.mcap map base_link -o robot.tum\n'
        '          tf_trajectory --bag robot.mcap map base_link --twist -o robot.npz')
    parser.add_argument('target_frame')
    parser.add_argument('source_frame')
    parser.add_argument('-o', '--output', metavar='FILE',
                        help='the file: a table (.csv, .npz, or .tum, which evo reads), or a '
                             'drawing (.png, .svg, .pdf); default: print the table in CSV')
    parser.add_argument('--every', type=number, metavar='SECONDS',
                        help='the interval between two rows (s; default: a row for each stamp)')
    parser.add_argument('--twist', action='store_true',
                        help='add the velocity of the origin of source_frame and its angular '
                             'velocity, both in the axes of target_frame, averaged over '
                             f'{TWIST_INTERVAL / SECOND:g} s')
    parser.add_argument('--time', type=number, dest='seconds', metavar='SECONDS',
                        help=f'how long to listen (s; default: {DEFAULT_TIME:g}); Ctrl-C ends it '
                             'earlier')
    add_bag_options(parser)
    return run(parser, command, args)
