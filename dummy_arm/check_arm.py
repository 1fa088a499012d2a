"""The command `check_arm`: judge the arm of the lab's final task, and its drawing frames.pdf."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
import csv
import os
from pathlib import Path
import sys
from typing import Optional

from dummy_arm.grading import grade
from dummy_arm.grading.drawing import judge
from dummy_arm.grading.observer import Observer
from dummy_arm.grading.records import Grade, Messages, Report, START, Verdict
from dummy_arm.grading.requirements import check
from dummy_arm.grading.samples import Arm
from puretf import TransformException
from puretf._text.names import comma_list, visible
from puretf_tools.cli.bag_options import add_bag_options, BagOption
from puretf_tools.cli.files import whole_file
from puretf_tools.cli.parser import CommandError, Parser, run, UsageError
from puretf_tools.cli.progress import listening_time, progress, wait
from puretf_tools.inspection.forest import Forest
from puretf_tools.inspection.graph import as_dot, draw, DrawingError
from puretf_tools.inspection.terminal import columns, wrapped

#: The default time to observe an arm (s). It is more than a period of the slowest joint: 20.9 s if
#: 0.3 rad/s is the speed of the phase, 16.4 s if it is that of the joint.
DEFAULT_TIME = 25.0
#: The largest number of transforms of a bag that are judged: those of an hour.
_MOST = 1_000_000
#: What `command` judges.
_PROGRAMS, _BAG, _DRAWINGS, _ARM = 'programs', 'a bag', 'drawings', 'the arm that is running'


# Hand-ins


def _grade_all(files: Sequence[str], seconds: float, jobs: int, table: Optional[str],
               feedback: Optional[str]) -> int:
    """Grade programs; print a line for each when it has been graded. Return the exit code."""
    older = _read_table(table) if table and os.path.isfile(table) else []
    # A file that is given twice runs once. The shell adds a slash to the name of a folder.
    rows = {file: _row(Grade(file, None, '', Verdict.NOT_RUN))
            for file in map(str, map(Path, files))}
    grades = grade([*rows], seconds, jobs, lambda done, what: show(done, what))
    try:
        while True:
            if table:
                _write_table(table, [*older, *rows.values()])
            with progress(len(rows), bar_format='{desc} {bar} {n} of {total}, {elapsed}') as show:
                result = next(grades, None)
            if not result:
                break
            print(result.line)
            rows[result.file] = _row(result)
            if feedback:
                _write_feedback(Path(feedback), result)
    except KeyboardInterrupt:
        count = sum(row['verdict'] == Verdict.NOT_RUN for row in rows.values())
        raise CommandError(f'interrupted: {count} of {len(rows)} were not run') from None
    finally:
        grades.close()
    return 0 if all(row['verdict'] == Verdict.OK for row in rows.values()) else 1


def _warn(text: object) -> None:
    print(f'check_arm: warning: {visible(str(text))}', file=sys.stderr)


def _row(grade: Grade) -> dict[str, str]:
    lines = (*grade.report.lines, *grade.report.advice) if grade.report else ()
    return {'file': _cell(visible(grade.file)), 'verdict': grade.verdict,
            'reason': _cell(grade.reason), 'frames.pdf': grade.drawing,
            **{line.requirement: line.verdict for line in lines}}


def _cell(text: str) -> str:
    """Return a text that spreadsheets do not take for a formula."""
    return f"'{text}" if text.startswith(('=', '+', '-', '@')) else text


def _titles() -> list[str]:
    return [*_row(Grade('', check(Arm([])), '', ''))]


def _read_table(path: str) -> list[dict[str, str]]:
    """Return the rows of an older table; raise CommandError if the file is no table."""
    # ValueError: it is no text, or empty, or a row has another length.
    with suppress(ValueError, csv.Error), open(path, newline='', encoding='utf-8-sig') as file:
        titles, *rows = csv.reader(file)
        if titles == _titles():
            return [dict(zip(titles, row, strict=True)) for row in rows]
    raise CommandError(f'{path} does not have the columns of a table of check_arm: remove it, or '
                       'name another file')


def _write_table(path: str, rows: Iterable[dict[str, str]]) -> None:
    """Write the last row of each file."""
    # Without a byte-order mark, spreadsheets assume the encoding of the country; some separate
    # cells by semicolons.
    with whole_file(Path(path)) as part, part.open('w', newline='', encoding='utf-8-sig') as file:
        writer = csv.DictWriter(file, _titles(), quoting=csv.QUOTE_ALL)
        writer.writeheader()
        writer.writerows({row['file']: row for row in rows}.values())


def _write_feedback(directory: Path, result: Grade) -> None:
    """Write the whole report of a hand-in, under its path from the working directory."""
    inside = os.path.normpath(f'/{os.path.relpath(result.file)}')  # no '..' leaves the directory
    path = directory / f'{inside[1:] or os.path.basename(os.path.abspath(result.file))}.txt'
    report = ['', *format_report(result.report)] if result.report else []
    drawing = ['', f'frames.pdf: {result.drawing}'] if result.drawing else []
    text = '\n'.join([result.line, *report, *drawing, ''])
    _write(path, lambda: text.encode(errors='backslashreplace'))


def _write(path: Path, content: Callable[[], bytes]) -> None:
    """Write a file; warn if it cannot be written: the others and the result matter more."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as part:
            part.write_bytes(content())
    except (CommandError, DrawingError, OSError, TransformException) as error:
        _warn(f'{path} is not written: {error}')


# The arm that is running, and a bag


def _check_running(seconds: float, namespace: str, ros_args: Sequence[str],
                   feedback: Optional[str]) -> Report:
    from puretf_tools.cli.node import spinning_node
    with spinning_node('check_arm', ros_args, namespace) as node:
        observer = Observer(node)
        if wait(START, 'waiting for an arm', observer.poll):
            wait(seconds, 'observing the arm', lambda: observer.poll() and False)
        elif not observer.messages:
            raise CommandError(f'no transform was received within {START:g} s. '
                               f'{observer.listener.why_nothing()}')
        if hint := observer.listener.wrong_type_hint():
            _warn(hint)
        report = observer.report()
        if feedback:
            _write_hand_in(Path(feedback), report, observer)
        return report


def _write_hand_in(directory: Path, report: Report, observer: Observer) -> None:
    """Write the report of an arm that is running, its frames.pdf and a picture of it."""
    from dummy_arm.grading.picture import picture
    listener = observer.listener
    dot = as_dot(Forest(listener.frames()), listener.now())
    _write(directory / 'report.txt', lambda: '\n'.join([*format_report(report), '']).encode())
    _write(directory / 'frames.pdf', lambda: draw(dot, 'pdf'))
    _write(directory / 'arm.svg', lambda: picture(listener.buffer).encode())


def _check_bag(option: BagOption) -> Report:
    found = Messages()
    with option.opened() as bag:
        for message in bag.messages():
            found.add(message)
            if found.size > _MOST:
                break
    return check(Arm(found))


def format_report(report: Report) -> list[str]:
    """Return the lines of the table of a report, with the verdict first."""
    shown = [row for row in report.lines if not row.follows]
    if len(shown) < len(report.lines):  # first of all, what the others follow from
        shown.sort(key=lambda row: row != report.first_failure)
    rows = [*shown, *(row for row in report.advice if row.is_judged)]
    firsts = {row.text: row for row in reversed(rows) if row.text}  # a cause is printed once
    texts = [row.text if firsts.get(row.text) is row else '' for row in rows]
    table = columns([(row.verdict, row.requirement, (row.measured if row.is_judged else text)
                      or 'see above' * (row.text != text)) for row, text in zip(rows, texts)])
    lines: list[str] = []
    for i, (row, text, line) in enumerate(zip(rows, texts, table)):
        if i == len(shown):
            lines += ['', 'good practice (it does not change the result):']
        lines += [line, *(wrapped(text, '    ') if text and row.is_judged else [])]
    counts = Counter(row.verdict for row in report.lines)
    counted = ', '.join(f'{counts[verdict]} {verdict}' for verdict in (
        Verdict.OK, Verdict.NOT_OK, Verdict.NOT_JUDGED) if counts[verdict])
    left = comma_list([row.requirement for row in report.lines if not row.is_judged])
    return [*lines, '', f'{"passed" if report.passed else "not passed"}: {counted}'
                        f'{f" ({left})" if left else ""}']


def command(files: Sequence[str] = (), seconds: Optional[float] = None,
            bag: Optional[BagOption] = None, namespace: str = '', frames: Sequence[str] = (),
            table: Optional[str] = None, feedback: Optional[str] = None,
            jobs: Optional[int] = None, *, ros_args: Sequence[str] = ()) -> int:
    """Judge programs, drawings, an arm in a bag, or the arm that is running; see `--help`."""
    duration = DEFAULT_TIME if seconds is None else seconds
    kind, *others = [kind for kind, is_given in (
        (_PROGRAMS, files), (_BAG, bag), (_DRAWINGS, frames)) if is_given] or [_ARM]
    if others:
        raise UsageError('give files of programs, or --bag, or --frames, or none of them to check '
                         'the arm that is running')
    for option, is_given, *kinds in (
            ('--time', seconds is not None, _PROGRAMS, _ARM),
            ('--namespace', namespace, _BAG, _ARM),
            ('--ros-args', '--ros-args' in ros_args, _BAG, _DRAWINGS, _ARM),
            ('--feedback', feedback is not None, _PROGRAMS, _ARM),
            ('--csv', table is not None, _PROGRAMS),
            ('--jobs', jobs is not None, _PROGRAMS)):
        if is_given and kind not in kinds:
            raise UsageError(f'{option} is for {" and ".join(kinds)}, not for {kind}')
    if table is not None and (table in files or not table.endswith('.csv')):
        raise UsageError(f'--csv needs the name of a file that ends in .csv, got {table!r}')
    if jobs is not None and jobs < 1:
        raise UsageError(f'--jobs must be at least 1, got {jobs}')
    if frames:
        drawings = [judge(Path(path)) for path in frames]
        print('\n'.join(each.line for each in drawings))
        return 0 if all(each.verdict == Verdict.OK for each in drawings) else 1
    if files:
        return _grade_all(files, duration, jobs or os.cpu_count() or 1, table, feedback)
    try:
        report = (_check_running(duration, namespace, ros_args, feedback) if bag is None
                  else _check_bag(bag))
    except KeyboardInterrupt:
        raise CommandError('interrupted: nothing was judged') from None
    print('\n'.join(format_report(report)))
    return 0 if report.passed else 1


def main(args: Optional[Sequence[str]] = None) -> int:
    parser = Parser(
        'check_arm', 'Check whether an arm meets the requirements of the final task of the lab. '
        'Without arguments, the arm that is running is observed. With files, each file is run as '
        'a program, with your own rights: run only programs that you trust, or use a container.',
        'exit code: 0: all requirements are met; 1: not all; 2: wrong arguments\n'
        'examples: check_arm\n          check_arm dummy_arm.py\n'
        '          check_arm --csv grades.csv handed_in/*\n'
        '          check_arm --bag arm_bag\n          check_arm --frames frames.pdf')
    parser.add_argument('files', nargs='*', metavar='FILE',
                        help='a program to run and to check, or a folder with a dummy_arm.py')
    parser.add_argument('--time', type=listening_time, dest='seconds', metavar='SECONDS',
                        help='how long to observe each arm (s; default: '
                             f'{DEFAULT_TIME:g}, more than a period of the slowest joint)')
    parser.add_argument('--frames', nargs='+', default=(), metavar='FILE',
                        help='check drawings of view_frames, as PDF')
    parser.add_argument('--csv', dest='table', metavar='OUT',
                        help='write a table with a row for each program; other rows stay')
    parser.add_argument('--feedback', metavar='DIR',
                        help='write the report of each program, and of the frames.pdf beside it; '
                             'of the arm that is running, what to hand in: the report, frames.pdf '
                             'and a picture')
    parser.add_argument('--jobs', type=int, metavar='N',
                        help='how many programs run at the same time (default: the number of '
                             'cores)')
    add_bag_options(parser)
    return run(parser, command, args, interrupted=1)
