"""The command `tf_doctor`: find faults in transforms, or explain the path between two frames."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial as partial_function
from itertools import chain
import json
from multiprocessing import active_children, get_context, resource_tracker
from pathlib import Path
import sys
import threading
from typing import Any, Optional, TYPE_CHECKING

from puretf import exact_time, in_seconds
from puretf._text.names import quoted, TF_MESSAGE, visible
from puretf.bag import is_bag, recordings
from puretf_tools.cli.bag_options import add_bag_options, bag_progress, BagOption, for_commands
from puretf_tools.cli.parser import frame_name, Parser, run, UsageError
from puretf_tools.cli.progress import progress
from puretf_tools.cli.signals import signals_blocked, sleep
from puretf_tools.cli.times import LATEST, WHEN, When, when
from puretf_tools.doctor.checks import CHECKS, ERROR, Finding
from puretf_tools.doctor.explanation import explain, Explanation
from puretf_tools.doctor.observation import listened, Observation
from puretf_tools.doctor.report import check_codes, examine, examine_bag, Report
from puretf_tools.doctor.stream import FUTURE
from puretf_tools.doctor.tf_statistics import Statistics
from puretf_tools.doctor.troubleshooting import explained
from puretf_tools.inspection.bag_times import both
from puretf_tools.inspection.gaps import in_words
from puretf_tools.inspection.terminal import wrapped
from puretf_tools.inspection.traffic import SETTLING
from puretf_tools.source import source

if TYPE_CHECKING:
    from rclpy.node import Node

#: The time between two looks at the processes that examine bags (s).
_POLL = 0.05


def command(frame_a: Optional[str], frame_b: Optional[str], t: When, seconds: float,
            as_json: bool, ignore: Sequence[str], list_codes: bool, bag: Optional[BagOption],
            namespace: str, jobs: Optional[int], words: Optional[Sequence[str]],
            ros_args: Sequence[str]) -> int:
    """Print what is wrong with the transforms, or explain the path between two frames."""
    if frame_a and not frame_b:
        note = f'; {quoted(frame_a)} is no bag' if bag and not is_bag(frame_a) else ''
        raise UsageError('give two frames to explain the path between them, or none to check '
                         f'everything{note}')
    if frame_a and frame_b and bag and len(recordings(bag.paths)) > 1:
        raise UsageError(f'{quoted(frame_a)} and {quoted(frame_b)} are no bags, and frames need '
                         'one recording')
    if t != LATEST and not frame_b:
        raise UsageError('-t needs two frames')
    try:
        check_codes(ignore)
        section = None if words is None else explained(' '.join(words).strip())
    except ValueError as error:
        raise UsageError(str(error)) from None
    if jobs is not None and (bag is None or frame_b or jobs < 1):
        raise UsageError(f'--jobs must be at least 1, got {jobs}' if jobs < 1 else
                         '--jobs is for examining bags, with --bag and without frames')
    if list_codes:
        for check in CHECKS.values():
            print(f'{check.code} ({check.severity})',
                  *wrapped(f'{check.meaning} {check.advice}'.strip(), '    '), sep='\n')
        return 0
    if section is not None:
        print(section)
        return 0
    if frame_a and frame_b:
        explanation = _explain((frame_a, frame_b), t, seconds, bag, namespace, ros_args)
        print(json.dumps(explanation.as_dict(), indent=2) if as_json else explanation)
        return int(bool(explanation.why_not))
    if bag is not None:
        return _examine_bags(bag.paths, jobs or 1, as_json, partial_function(
            examine_bag, ignore=ignore, namespace=namespace, partial=bag.is_partial))
    report = examine(_observe_live(seconds, ros_args, namespace), ignore=ignore)
    print(json.dumps(report.as_dict(), indent=2) if as_json else report)
    return int(report.has_errors)


# Bags


def _examine_bags(bag: Sequence[str], jobs: int, as_json: bool,
                  examine_one: Callable[..., dict[str, Any]]) -> int:
    """Print a report for each recording, in their order; return the exit code."""
    found = recordings(bag)
    counts = Counter[str]()
    for result in _results(found, jobs, examine_one):
        if 'error' in result:
            result['error'] = for_commands(result['error'])
        counts['not readable' if 'error' in result else 'with errors' if any(
            each['severity'] == ERROR for each in result['findings']) else 'without errors'] += 1
        if as_json:
            print(json.dumps(result))
        elif 'error' in result:
            print(f'tf_doctor: {visible(result["error"])}', file=sys.stderr)
        else:
            report = Report([Finding(**each) for each in result['findings']],
                            result['topics'], result['not_checked'], result['verdict'])
            print(report, end='\n\n' if len(found) > 1 else '\n')
    if len(found) > 1:
        kinds = 'without errors', 'with errors', 'not readable'
        print(f'{len(found)} bags: {", ".join(f"{counts[kind]} {kind}" for kind in kinds)}',
              file=sys.stderr)
    return int(counts['without errors'] < len(found))


def _results(found: Sequence[Sequence[Path]], jobs: int,
             examine_one: Callable[..., dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Examine recordings in this process or in several, with a bar; yield the results in order."""
    if jobs == 1 or len(found) == 1:
        for paths in found:
            with bag_progress([str(paths[0])]) as on_progress:
                result = examine_one(paths, on_progress=on_progress)
            yield result
        return
    with progress(len(found), desc='examining bags', unit='bag') as show:
        # Each thread waits for a process of its own, so that a process that is killed costs only
        # one result. A forked process could hold locks of threads that it does not have.
        local = threading.local()

        def examine_in_process(paths: Sequence[Path]) -> dict[str, Any]:
            if not hasattr(local, 'executor'):
                local.executor = ProcessPoolExecutor(1, get_context('spawn'))
            try:
                result: dict[str, Any] = local.executor.submit(examine_one, paths).result()
                return result
            except BrokenExecutor:
                del local.executor
                return {'bag': str(paths[0]),
                        'error': f'the process that read {paths[0]} was killed, perhaps for lack '
                                 'of memory: use fewer --jobs'}

        if sys.platform != 'win32':  # the thread that starts it would unblock signals
            resource_tracker.ensure_running()
        with ThreadPoolExecutor(min(jobs, len(found))) as executor:
            with signals_blocked():  # in the threads and the processes; this thread ends them
                futures = [executor.submit(examine_in_process, paths) for paths in found]
            try:
                for future in futures:
                    while not future.done():
                        show(sum(each.done() for each in futures))
                        sleep(_POLL)
                    yield future.result()
            finally:
                executor.shutdown(wait=False, cancel_futures=True)
                for process in active_children():
                    process.kill()


# The path between two frames


def _explain(ends: tuple[str, str], when: When, seconds: float, bag: Optional[BagOption],
             namespace: str, ros_args: Sequence[str]) -> Explanation:
    with source('tf_doctor', bag, namespace, ros_args, seconds) as found:
        stamp, listener = when.within(found.span), found.listener
        found.listen(seconds)
        explanation = explain(found.buffer, ends, stamp)
        if listener:
            nodes = listener.names_of(frame.authority for frame in explanation.path)
            explanation = explanation._replace(path=[
                frame._replace(authority=nodes[frame.authority]) for frame in explanation.path])
        if explanation.why_not:
            return explanation._replace(
                why_not=found.why_not(*ends, stamp) or explanation.why_not)
        if not explanation.stamp or (listener and stamp):
            return explanation
        if listener:
            clock = listener.clock_text()
            text = (f'{explanation.when}{_age(listener.now(), explanation.stamp)}'
                    f'{clock and f" ({clock})"}')
        else:
            note = found.interpolated(*ends, explanation.stamp)
            text = f'at {both(explanation.stamp, found.span[0])}{note and f". It is {note}"}'
        return explanation._replace(when=text)


def _age(now: int, stamp: int) -> str:
    if not now:
        return ' (use_sim_time is set, but no message has arrived on /clock)'
    if stamp > now + FUTURE:
        return f', {in_words(stamp - now)} after the time of this node, {exact_time(now)}'
    return f', {in_seconds(max(0, now - stamp)):.3f} s before the end of listening'


# A live system


def _observe_live(seconds: float, ros_args: Sequence[str], namespace: str) -> Observation:
    """Listen to transforms and to what is beside them; add what the ROS graph knows."""
    from puretf.publisher_listener import nodes_on, TransformSampler
    from puretf_tools.inspection.clock_sampler import SimTimeSurvey
    from puretf_tools.inspection.header_sampler import HeaderSampler
    from puretf_tools.robot.description_listener import RobotListener
    with source('tf_doctor', None, namespace, ros_args) as found, ExitStack() as stack:
        listener = found.listener
        assert listener
        node, statistics = listener.node, Statistics(SETTLING, listener.clock)
        dropped: list[int] = []
        static, dynamic = listener.topics
        headers, robots, pulse = HeaderSampler(node), RobotListener(node, dynamic), listener.pulse
        transforms = TransformSampler(node, (static, dynamic))
        clock = listener.clock_sampler
        survey = SimTimeSurvey(node, clock, lambda: {
            *nodes_on(node, dynamic), *robots.subscribers(dynamic),
            *chain.from_iterable(headers.senders().values())})
        for sampler in headers, robots, transforms:
            stack.callback(sampler.close)

        def poll() -> None:
            messages, number = listener.dated()
            statistics.add_messages(messages)
            dropped.append(number)
            for each in survey, headers, robots, transforms:
                each.poll()

        elapsed, joint_senders = found.listen(seconds, poll), robots.senders()
        left_out = [f'headers on {topic}: {why}'
                    for topic, why in sorted(headers.not_read.items())]
        if any(dropped):
            left_out.append(f'{sum(dropped)} messages: they arrived too fast')
        return listened(
            listener, statistics, f'in {elapsed:.1f} s', elapsed, {},
            volatile_listeners=_volatile_listeners(node, static), headers=headers.headers,
            senders=headers.senders(), robots=robots.robots(), joint_senders=joint_senders,
            joint_readers={topic: robots.subscribers(topic) for topic in joint_senders},
            clocks=clock.senders(), clears=clock.jumps, use_sim_time={**survey.answers},
            tf_listeners=robots.subscribers(dynamic),
            other_transforms=transforms.heard(),
            tf_topics=[topic for topic, types in node.get_topic_names_and_types()
                       if TF_MESSAGE in types and node.count_publishers(topic)],
            left_out=left_out, clock_text=listener.clock_text(), clock_stands=clock.stands(),
            around=listener.around(), late=pulse.late(elapsed))


def _volatile_listeners(node: 'Node', topic: str) -> list[str]:
    from rclpy.qos import DurabilityPolicy

    from puretf.publisher_listener import node_of
    return [node_of(info) for info in node.get_subscriptions_info_by_topic(topic)
            if info.topic_type == TF_MESSAGE
            and info.qos_profile.durability == DurabilityPolicy.VOLATILE]


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command with some arguments, or those of the command line."""
    parser = Parser(
        'tf_doctor', 'Find faults in the transforms, and say what to do. If two frames are named, '
        'explain the path between them instead. The exit code is 1 if there is an error, or no '
        'transform between the two frames.',
        'examples: tf_doctor\n          tf_doctor --bag robot.mcap\n'
        '          tf_doctor --bag recordings/*.mcap --jobs 4 --json\n'
        '          tf_doctor map end_effector\n          tf_doctor --explain future')
    for name in 'frame_a', 'frame_b':
        parser.add_argument(name, nargs='?', type=frame_name)
    parser.add_argument('-t', type=when, default=LATEST, metavar='TIME',
                        help=f'with two frames: {WHEN} (default: 0)')
    parser.add_argument('--json', dest='as_json', action='store_true',
                        help='print JSON: with --bag, one line for each bag')
    parser.add_argument('--ignore', action='append', default=[], metavar='CODE',
                        help='leave out findings with this code; can be given several times')
    parser.add_argument('--list', dest='list_codes', action='store_true',
                        help='print the codes of all findings with their meanings, then exit')
    parser.add_argument('--explain', dest='words', nargs='*', metavar='WORDS',
                        help='explain an error: print the section that has a short name, explains '
                        'the code of a finding, or has some words in its heading; without words, '
                        'list the sections')
    parser.add_argument('--jobs', type=int, metavar='N',
                        help='with several bags: how many are examined at the same time '
                        '(default: 1)')
    add_bag_options(parser, '--time')
    return run(parser, command, args)
