"""The command `tf_trajectory`: write or draw the pose of a frame in another one over time."""

from collections.abc import Callable, Iterable, Iterator, Sequence
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

from dummy_arm.cli.bag_options import add_bag_options, read_bag
from dummy_arm.cli.files import check_writable, whole_file
from dummy_arm.cli.parser import (
    CommandError,
    DEFAULT_TIME,
    listening_time,
    number,
    Parser,
    run,
    UsageError,
)
from dummy_arm.cli.progress import listen, progress
from dummy_arm.cli.signals import check_signals, forget_signals
from dummy_arm.tf import BufferCore, TransformException
from dummy_arm.tf.formatting import SECOND, shortened, visible

if TYPE_CHECKING:
    from dummy_arm.tf import MessageBufferCore

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

#: The buffer of a bag, or of a listener.
AnyBuffer = Union[BufferCore, 'MessageBufferCore']
#: Stamps, (n,) int64 (ns), and values, (n, 10) or, with a twist, (n, 16) float64; see `POSE` and
#: `TWIST`.
Rows = tuple[NDArray[np.int64], NDArray[np.float64]]


class Trajectory:
    """The poses of a source frame in a target frame at many times, looked up part by part."""

    def __init__(self, buffer: AnyBuffer, target: str, source: str, times: NDArray[np.int64],
                 has_twist: bool) -> None:
        """
        Create a trajectory; nothing is looked up yet.

        :param buffer: the buffer with the transforms.
        :param target: the frame in which the poses are expressed.
        :param source: the frame whose poses are looked up.
        :param times: (n,) times (ns), in increasing order.
        :param has_twist: True: look up the velocities, too.
        """
        self.target, self.source, self.times, self.has_twist = target, source, times, has_twist
        self._buffer = buffer
        #: The number of rows so far, and the stamps of the first and the last of them (ns).
        self.count = self.begin = self.end = 0
        #: The number of times left out so far, the first of them (ns), and why it was left out.
        self.left_out = self.first_left_out = 0
        self.reason = ''
        #: Called with the number of times that have been looked up.
        self.on_progress: Callable[[float], object] = lambda done: None

    def parts(self) -> Iterator[Rows]:
        """
        Look up the poses, and count the rows.

        :returns: an iterator over parts of the rows. There is a row for each time. If it is left
            out, because there is no transform at this time, its values are NaN.
        :raises CommandError: if all rows are left out.
        :raises KeyboardInterrupt: if Ctrl-C or SIGTERM was received; see `dummy_arm.cli.signals`.
        """
        for begin in range(0, len(self.times), _PART):
            check_signals()
            times = self.times[begin:begin + _PART]
            yield self._part(times)
            self.on_progress(begin + len(times))
        if not self.count:
            raise CommandError(f'no row has a transform{" and a velocity" * self.has_twist}; the '
                               f'first of {self.left_out}, at {_seconds(self.first_left_out)} s: '
                               f'{self.reason}')

    def rows(self) -> Iterator[Rows]:
        """
        Look up the poses, and count the rows.

        :returns: an iterator over parts of the rows, without those that are left out.
        :raises CommandError: as `parts`.
        :raises KeyboardInterrupt: as `parts`.
        """
        for stamps, values in self.parts():
            known = ~np.isnan(values[:, 0])
            if known.any():
                yield stamps[known], values[known]

    def _part(self, times: NDArray[np.int64]) -> Rows:
        """Look up the poses at some times."""
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
    Convert rotations to roll, pitch and yaw, as `euler_from_quaternion` of rotations does.

    :param quaternions: (n, 4) float64: x, y, z, w, of length 1 or NaN.
    :returns: (n, 3) float64: the angles about the fixed axes x, y and z (rad).
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
            bag: Optional[str] = None, namespace: str = '', partial: bool = False, *,
            ros_args: Sequence[str] = ()) -> int:
    """
    Write or draw the poses of the source frame in the target frame over time.

    :param target_frame: the frame in which the poses are expressed.
    :param source_frame: the frame whose poses are looked up.
    :param output: path of the file. Its ending gives the format; see `TABLES` and `DRAWINGS`.
        None: print the table in CSV.
    :param every: the interval between two rows (s), counted from the first stamp; None: a row for
        each stamp of the dynamic transforms between the two frames.
    :param twist: True: write or draw the velocities, too.
    :param seconds: how long to listen (s); None: 5 s.
    :param bag: path of the bag to read; None: listen.
    :param namespace: the namespace of the topics `tf` and `tf_static`; '': none.
    :param partial: True: if the bag is damaged, read its undamaged parts.
    :param ros_args: the command line, with the name of the command; ROS reads what follows
        `--ros-args`.
    :returns: the exit code.
    :raises UsageError: if the name of a frame is empty, if the format is unknown or has no place
        for velocities, if a number is out of range, or if `seconds` is set together with `bag`;
        also in the cases of `read_bag`.
    :raises CommandError: if there is no trajectory, if the bag cannot be read, if matplotlib is
        missing, or if the file cannot be written.
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
    trajectory = Trajectory(buffer, target, source, times[::step], twist)
    with ExitStack() as stack:
        if path is not None or not sys.stdout.isatty():  # no bar within a table in the terminal
            trajectory.on_progress = stack.enter_context(progress(
                len(trajectory.times), desc='looking up',
                bar_format='{desc} {bar} {n} of {total} rows'))
        if path is None:
            _write_csv(sys.stdout, trajectory.rows(), twist)
        else:
            part = stack.enter_context(whole_file(path))
            _write(part, path.suffix.lower(), trajectory, step)
            check_signals()
    some = f', of {len(times)} rows one of {step}' if step > 1 else ''
    rows = '1 row' if trajectory.count == 1 else f'{trajectory.count} rows'
    summary = (f'{rows} from {_seconds(trajectory.begin)} s to {_seconds(trajectory.end)} s'
               f'{some}')
    if path is None:
        print(f'tf_trajectory: {summary}', file=sys.stderr)
    else:
        print(f'wrote {visible(str(path))}: {summary}')
    if trajectory.left_out:
        left_out, all_rows = trajectory.left_out, len(trajectory.times)
        print(f'tf_trajectory: {left_out} of {all_rows} rows {"are" if left_out > 1 else "is"} '
              f'left out, without a transform{" or a velocity" if twist else ""}; the first, at '
              f'{_seconds(trajectory.first_left_out)} s: {visible(trajectory.reason)}',
              file=sys.stderr)
    return 0


def _output_path(output: str, twist: bool) -> Path:
    """
    Check that a file can be written, and return its path.

    :raises UsageError: if the ending is unknown, or if the format has no place for velocities.
    :raises CommandError: if the file cannot be written, or if matplotlib is needed and missing.
    """
    path = Path(output)
    ending = path.suffix.lower()
    if ending not in (*TABLES, *DRAWINGS) or output.endswith('/'):
        raise UsageError(f'{output!r} must end in {", ".join((*TABLES, *DRAWINGS))}')
    if twist and ending == '.tum':
        raise UsageError('a .tum file has no place for velocities: leave out --twist, or write '
                         f'another format than {output!r}')
    check_writable(path)
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
            ) -> 'MessageBufferCore':
    """
    Listen for some time, or until Ctrl-C or SIGTERM; return a buffer with what was received.

    :raises CommandError: if nothing that was received connects the two frames.
    """
    from dummy_arm.cli.node import spinning_node
    from dummy_arm.inspection.frame_listener import FrameListener
    with spinning_node('tf_trajectory', ros_args, namespace) as node:
        frame_listener = FrameListener(node, seconds + _MARGIN)
        listen(seconds, frame_listener.buffer.frame_names)
        try:
            frame_listener.buffer.path_stamps(target, source)
        except TransformException as error:
            why = frame_listener.why_no_transform(target, source)
            raise CommandError(why or str(error)) from None
    forget_signals()  # the first Ctrl-C has ended the recording; another one ends the command
    return frame_listener.buffer


def _times(buffer: AnyBuffer, target: str, source: str, every: Optional[float]
           ) -> NDArray[np.int64]:
    """
    Return the times (ns) of the rows: the stamps, or with `every` (s) times at equal distances.

    :raises UsageError: if there would be more than `MAX_ROWS` times at equal distances.
    :raises CommandError: if nothing connects the two frames, or if they do not move.
    """
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
                         f'possible: choose at least {(last - first) / MAX_ROWS / SECOND:.2g} s')
    return first + period * np.arange(count, dtype=np.int64)


def _seconds(stamp: int) -> str:
    """
    Format a time (ns) in s, without rounding.

    >>> _seconds(1_700_000_000_000_000_001), _seconds(-1_500_000_000)
    ('1700000000.000000001', '-1.500000000')
    """
    whole, fraction = divmod(abs(stamp), SECOND)
    return f'{"-" if stamp < 0 else ""}{whole}.{fraction:09d}'


def _write(path: Path, ending: str, trajectory: Trajectory, step: int) -> None:
    """
    Write a trajectory to a file.

    :param path: path of the file.
    :param ending: its format; see `TABLES` and `DRAWINGS`.
    :param trajectory: the trajectory.
    :param step: the part of all rows that is drawn, for the title of a drawing: one of `step`.
    """
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
    """Write a header and a line for each row; floats are written so that no bit is lost."""
    header = ','.join(('stamp_ns', *POSE, *(TWIST if has_twist else ()))) + '\n'
    for stamps, values in rows:
        file.write(header + ''.join(
            f'{stamp},{",".join(map(repr, row))}\n'
            for stamp, row in zip(stamps.tolist(), values.tolist())))
        header = ''


def _write_tum(file: TextIO, rows: Iterable[Rows]) -> None:
    """Write a line for each row: time (s), x, y, z (m) and the quaternion x, y, z, w."""
    for stamps, values in rows:
        file.write(''.join(
            f'{_seconds(stamp)} {" ".join(map(repr, row))}\n'
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
    """
    Draw positions, angles and velocities over time, and the path from above.

    :raises CommandError: if a number is larger than `LARGEST_DRAWN`.
    """
    from matplotlib.figure import Figure
    stamps, values = (np.concatenate(each) for each in zip(*trajectory.parts()))
    if (too_large := np.argwhere(abs(values) > LARGEST_DRAWN)).size:
        row, column = too_large[0]
        raise CommandError(
            f'the pose of {trajectory.source!r} in {trajectory.target!r} is too large to draw: '
            f'{(*POSE, *TWIST)[column]} is {values[row, column]:g} at {_seconds(stamps[row])} s, '
            f'and the limit is {LARGEST_DRAWN:g}. Write a table ({", ".join(TABLES)})')
    times = (stamps - trajectory.begin) / SECOND
    x, y, _ = values[:, ARRAYS['positions']].T
    panels = [('position (m)', 'xyz', values[:, ARRAYS['positions']]),
              ('angle (°)', ('roll', 'pitch', 'yaw'), np.degrees(values[:, ARRAYS['rpy']]))]
    if trajectory.has_twist:
        panels += [('velocity (m/s)', 'xyz', values[:, ARRAYS['linear']]),
                   ('angular velocity\n(rad/s)', 'xyz', values[:, ARRAYS['angular']])]
    style: dict[str, Any] = {'linewidth': 1.2, 'marker': '.' if trajectory.count < 100 else ''}
    figure = Figure(figsize=(11.0, 1.0 + 2.1 * len(panels)), layout='constrained')
    grid = figure.add_gridspec(len(panels), 2, width_ratios=(3, 2))
    first: Any = None
    for i, (label, names, columns) in enumerate(panels):
        axes = figure.add_subplot(grid[i, 0], sharex=first)
        first = first or axes
        for name, column in zip(names, columns.T):
            if i == 1:
                axes.plot(*_without_jumps(times, column), label=name, **style)
            else:
                axes.plot(times, column, label=name, **style)
        axes.set_ylabel(label)
        axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), frameon=False)
        axes.tick_params(labelbottom=i == len(panels) - 1)
        axes.ticklabel_format(useOffset=False)
        axes.grid(alpha=0.3)
    axes.set_xlabel(f'time (s), from {_seconds(trajectory.begin)} s')
    figure.align_ylabels()
    above = figure.add_subplot(grid[:, 1])
    above.plot(x, y, color='black', **style)
    for i, marker, color, label in ((0, 'o', 'tab:green', 'start'), (-1, 's', 'tab:red', 'end')):
        row = np.flatnonzero(~np.isnan(x))[i]
        above.plot(x[row], y[row], marker, color=color, label=label)
    above.set_aspect('equal', adjustable='datalim')
    above.set(xlabel='x (m)', ylabel='y (m)', title='path from above')
    above.ticklabel_format(useOffset=False)
    above.legend()
    above.grid(alpha=0.3)
    some = f', one of {step} rows' if step > 1 else ''
    figure.suptitle(f'{shortened(trajectory.source)} in {shortened(trajectory.target)}{some}',
                    parse_math=False)
    # Where a file cannot be written, the PDF backend raises other errors than OSError.
    drawing = BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # names may have characters that the font does not have
        figure.savefig(drawing, format=ending[1:], dpi=110)
    path.write_bytes(drawing.getvalue())


def _without_jumps(times: NDArray[np.float64], angles: NDArray[np.float64]
                   ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Break the line of an angle where it jumps from 180 to -180 degrees, or back.

    :param times: (n,) times (s).
    :param angles: (n,) angles (degrees).
    :returns: times and angles, with NaN between two angles that differ by more than 180 degrees.
    """
    jumps = np.flatnonzero(abs(np.diff(angles)) > 180.0) + 1
    return np.insert(times, jumps, np.nan), np.insert(angles, jumps, np.nan)


def main(args: Optional[Sequence[str]] = None) -> int:
    """
    Run the command; see `--help`.

    :param args: the command line without the name of the command; None: `sys.argv[1:]`.
    :returns: the exit code.
    """
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
