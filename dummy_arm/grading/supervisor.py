"""
The process that runs a hand-in, observes its arm, and ends all that it has started.

The middleware can hang or crash, and this process with it. Then the command reports that, and ends
what is left.
"""

from contextlib import ExitStack, suppress
from multiprocessing.connection import Connection
import os
from pathlib import Path
from tempfile import TemporaryDirectory
import time
import warnings

from dummy_arm.grading import drawing, processes
from dummy_arm.grading.observer import Observer
from dummy_arm.grading.program import Program, program_in, ProgramError
from dummy_arm.grading.records import Grade, START, Verdict
from puretf._causes.domains import ros_domains
from puretf._text.names import comma_list
from puretf_tools.cli.parser import CommandError
from puretf_tools.cli.signals import wait_until

#: How long to wait before the next look at the processes (s).
_SCAN_INTERVAL = 0.25
#: The limits of all processes of a hand-in together.
_MOST_PROCESSES, _MOST_MEMORY = 128, 2 * 2**30


def supervise(connection: Connection, file: str, seconds: float, directory: str, domain: int
              ) -> None:
    """
    Run and judge a hand-in, and the frames.pdf beside it.

    :param connection: sends the Grade. If the other end is closed, this process ends.
    :param file: the path of the program, or of a folder in which it lies.
    :param seconds: how long to observe the arm (s).
    :param directory: a directory for what the program writes.
    :param domain: the ROS domain of the program.
    """
    warnings.simplefilter('ignore')  # of the compiler about the program, and of large numbers
    os.environ['ROS_DOMAIN_ID'] = str(domain)
    processes.become_subreaper()
    folders, node = [Path(file)], ExitStack()
    with TemporaryDirectory(dir=directory, ignore_cleanup_errors=True) as directory:
        try:
            path = program_in(Path(file))
            folders.append(path.parent)
            program = Program(path, directory)
            grade = _observed(file, connection, program, seconds, domain, node)
        except CommandError as error:
            verdict = Verdict.NOT_OK if isinstance(error, ProgramError) else Verdict.NOT_JUDGED
            grade = Grade(file, None, str(error), verdict)
        with suppress(OSError):  # the command has ended
            connection.send(grade._replace(drawing=next((
                drawing.judge(each).result for folder in folders
                for name in ('frames.pdf', 'report/frames.pdf')
                if os.path.exists(each := folder / name)), 'missing')))
        processes.end_descendants()
    os._exit(0)  # without a shutdown of ROS, which can hang: the program may be killed


def _observed(file: str, connection: Connection, program: Program, seconds: float, domain: int,
              stack: ExitStack) -> Grade:
    """Run a program, and judge its arm; the node is spun until the stack is closed."""
    from puretf_tools.cli.node import spinning_node

    # The report has what matters; the lines of several programs would be mixed.
    observer = Observer(stack.enter_context(spinning_node('check_arm', [
        'check_arm', '--ros-args', '--log-level', 'tf2_buffer:=fatal'])))
    usual, next_scan = os.stat('/proc').st_nlink, 0.0  # links: of each process, and some more

    def watch() -> bool:
        """Raise what is wrong with the program or its processes, or that the command has ended."""
        nonlocal next_scan
        if connection.poll():
            raise CommandError('The command has ended.')
        program.check()
        # Among thousands of running processes, this one would hardly run.
        is_crowd = os.stat('/proc').st_nlink > usual + _MOST_PROCESSES
        if time.monotonic() < next_scan and not is_crowd:
            return False
        found = processes.descendants()
        if len(found) > _MOST_PROCESSES:
            processes.end_descendants()
            raise ProgramError(f'It starts more than {_MOST_PROCESSES} processes.')
        if sum(each.info['memory_info'].rss for each in found) > _MOST_MEMORY:
            raise ProgramError(f'It uses more than {_MOST_MEMORY // 2**30} GiB of memory, with '
                               f'all that it has started ({len(found)} processes).')
        next_scan = time.monotonic() + _SCAN_INTERVAL
        return False

    program.start()
    try:
        if has_begun := wait_until(START, lambda: watch() or observer.poll()):
            wait_until(seconds, lambda: watch() or (observer.poll() and False))
        report = observer.report(program.int_line, '' if has_begun else program.place(), watch)
        program.check()
        fault = '' if report.passed else observer.listener.wrong_type_hint()
        if not observer.publishers and not report.passed and (others := sorted(
                {*ros_domains([each.pid for each in processes.descendants()])} - {domain})):
            fault = (f'It uses the ROS domain {others[0]}: leave out ROS_DOMAIN_ID and domain_id; '
                     'the user sets the domain.')
        if not observer.messages and not fault and (nodes := observer.lifecycle_nodes()):
            fault = f'{comma_list(nodes)} is a lifecycle node: is it configured and activated?'
    finally:
        program.end()
    first = report.first_failure
    return Grade(file, report, fault or report.reason, Verdict.NOT_OK if fault else
                 first.verdict if first else Verdict.OK)
