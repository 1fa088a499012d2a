"""The command `web_view`: show the frames, live or from a bag, in the browser."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from math import inf
from pathlib import Path
import sys
from threading import Thread
from typing import Optional

from puretf import TransformBuffer
from puretf._text.names import namespace_path, quoted, visible
from puretf._text.similar_names import suggest_names
from puretf.bag import Bag
from puretf_tools.cli.bag_options import add_bag_options, BagOption
from puretf_tools.cli.files import path_to_write, whole_file
from puretf_tools.cli.page_options import add_page_options, HOST
from puretf_tools.cli.parser import CommandError, Parser, run, UsageError
from puretf_tools.cli.progress import BAR, listening_time, progress
from puretf_tools.cli.signals import check_signals
from puretf_tools.doctor.observation import BagObserver
from puretf_tools.doctor.report import examine
from puretf_tools.view.feed import BagFeed, Feed, LiveFeed

_EXPORTED_TIME = 10.0
#: How long the thread that reads a bag may take to end (s).
_LONGEST_END = 0.5


def command(host: str = HOST, port: Optional[int] = None, bag: Optional[BagOption] = None,
            namespace: str = '', export: Optional[str] = None,
            duration: Optional[float] = None, meshes: Sequence[str] = (), follow: str = '',
            view: Optional[str] = None, *, ros_args: Sequence[str] = ()) -> int:
    """Show the frames on a web page, until Ctrl-C; or write the page to a file."""
    if duration is not None and export is None:
        raise UsageError('--time needs --export')
    show = partial(_show, host, port, meshes, view)
    path = None if export is None else path_to_write(export, ['.html'])
    if not bag:  # that ROS is missing is said first
        from puretf_tools.cli.node import spinning_node
    from puretf_tools.view import viser_private  # noqa: F401  (it says if viser is missing)
    if bag:
        feed = BagFeed(TransformBuffer(2**63 - 1, max_samples=None), Path(bag.paths[0]).name)
        feed.follow = follow
        if path:
            with bag.opened() as opened:
                read_into(feed, opened)
            feed.update()
            _export(feed, duration or inf, meshes, path)
        else:
            _show_bag(bag, feed, show)
    else:
        with spinning_node('web_view', ros_args, namespace) as node:
            live = LiveFeed(node)
            live.follow = follow
            if path:
                _export(live, duration or _EXPORTED_TIME, meshes, path)
            else:
                show(live)
    return 0


def _show_bag(bag: BagOption, feed: BagFeed, show: Callable[[Feed], None]) -> None:
    """Serve the page of a bag, which a thread reads meanwhile."""
    def on_progress(done: float) -> None:
        check_signals()
        feed.done = done

    def read() -> None:
        try:
            read_into(feed, opened)
        except BaseException as error:
            feed.error = error

    with bag.opened(on_progress) as opened:
        reading = Thread(target=read, daemon=True)
        reading.start()
        try:
            show(feed)
        finally:
            reading.join(_LONGEST_END)


def read_into(feed: BagFeed, bag: Bag) -> None:
    """Read a bag in one pass: its transforms, and at the end its robots and findings."""
    feed.done, feed.player.is_whole = 0.0, False
    observer = BagObserver()
    bag.read(headers=True, others=observer.wanted, on_message=observer.add, buffer=feed.buffer)
    feed.player.recorded, feed.done = (bag.begin, bag.end), None
    feed.missing_spans = bag.missing_spans
    namespace = f'{namespace_path(bag.namespace)}/'
    feed.robots = {topic: each for topic, each in observer.robots.descriptions.items()
                   if topic.startswith(namespace)}
    try:
        report = examine(observer.observation(bag))
        feed.findings, feed.verdict = report.findings, report.verdict
    except Exception as error:
        feed.verdict = f'tf_doctor cannot examine the bag: {error or type(error).__name__}'


def _export(feed: Feed, seconds: float, meshes: Sequence[str], path: Path) -> None:
    from puretf_tools.view.export import Animation
    animation = Animation(feed, meshes)
    animation.record(seconds)
    if not animation.moments:
        raise CommandError(f'cannot write {path}: there are no frames. {feed.why_no_frames()}')
    names = tuple(feed.buffer.frame_names())
    if feed.follow and feed.follow not in names:
        raise CommandError(f'cannot follow {quoted(feed.follow)}: there is no such frame. '
                           f'{suggest_names(feed.follow, names)}')
    duration = animation.duration
    with progress(duration, desc='making the page', bar_format=BAR) as on_progress:
        page = animation.as_html(on_progress)
    for problem in animation.problems:
        print(f'web_view: not drawn: {visible(problem)}', file=sys.stderr)
    with whole_file(path) as part:
        part.write_text(page, encoding='utf-8')
    print(f'wrote {visible(str(path))}: {duration:.1f} s')


def _show(host: str, port: Optional[int], meshes: Sequence[str], view: Optional[str], feed: Feed
          ) -> None:
    from puretf_tools.view.server import serve
    from puretf_tools.view.settings import Settings
    from puretf_tools.view.view import show
    first = ''
    if view is not None:
        try:
            first = Path(view).read_text('utf-8', 'replace').strip()
        except OSError as error:
            raise CommandError(f'cannot read {view}: {error.strerror}') from None
        if why := Settings().restore(first):
            raise CommandError(f'{view}: {why}')
    with suppress(KeyboardInterrupt), serve(host, port) as server:  # Ctrl-C is its normal end
        show(feed, server, meshes, first)


def main(args: Optional[Sequence[str]] = None) -> int:
    parser = Parser(
        'web_view', 'Show the frames of /tf and /tf_static, or of a bag, on a page in the '
        'browser.',
        'examples: web_view\n          web_view --port 8090\n          web_view --bag robot.mcap\n'
        '          web_view --export robot.html')
    add_page_options(parser)
    add_bag_options(parser)
    parser.add_argument('--export', metavar='FILE.html',
                        help='write a page that plays without a server, and end')
    parser.add_argument('--time', dest='duration', type=listening_time, metavar='SECONDS',
                        help='with --export: how long to record, from the first transform on '
                             f'(default: {_EXPORTED_TIME:g}; of a bag, all)')
    parser.add_argument('--follow', default='', metavar='FRAME',
                        help='a frame that stays in the picture while it drives')
    parser.add_argument('--view', metavar='FILE.json',
                        help='what the page shows at first: the line of its "copy view"')
    return run(parser, command, args)
