"""The command `view_frames`: any trees, any names, and files that cannot be written."""

import os
from pathlib import Path
import random
import re
import signal
import subprocess
import sys
import threading
import time
from xml.etree import ElementTree

from builtin_interfaces.msg import Time
from conftest import (
    BEGUN,
    is_running,
    run_in_terminal,
    TIMEOUT,
    tool,
    tool_without,
    tool_without_ros,
)
from imports import ROS
import pytest
from rosgraph_msgs.msg import Clock

from dummy_arm.cli.parser import CommandError, UsageError
from dummy_arm.inspection.forest import Forest
from dummy_arm.inspection.graph import as_dot, draw
from dummy_arm.tf import StaticTransformBroadcaster, TransformBroadcaster
from dummy_arm.tf._core.frames import Frame
from dummy_arm.tf._core.pose import Row
from dummy_arm.tf._ros.transform_stamped import message_of
from dummy_arm.tools import view_frames

S = 10**9
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
LISTENING = 6.0  # s; a second publisher may be discovered 3 s after the first
ODD = ['54', 'on', 'a: b', 'say "hi"', 'two\nlines', 'ünï', 'back\\slash', 'end\\', '<b>b</b>',
       '&amp;', '{x|y}', '\\N', '--', 'digraph', "it's", 'n' * 80]


def static(name, parent, publisher='/node'):
    """Return a static frame."""
    return Frame(name, parent, publisher, True, 1, 0, 0)


def dynamic(name, parent, hertz=10, seconds=5, publisher='/node'):
    """Return a dynamic frame."""
    return Frame(name, parent, publisher, False, hertz * seconds + 1, 100 * S, (100 - seconds) * S)


def chain(length):
    """Return a forest in which each frame is the parent of the next: 0, 1, and so on."""
    return Forest([dynamic(f'{i + 1}', f'{i}') for i in range(length)])


def drawn_lines(frames, tmp_path):
    """Draw frames into a PDF, and return the lines of its text."""
    pypdf = pytest.importorskip('pypdf')
    path = tmp_path / 'drawn.pdf'
    path.write_bytes(draw(as_dot(Forest(frames), 100 * S), 'pdf'))
    (page,) = pypdf.PdfReader(path).pages
    return [line.strip() for line in page.extract_text().splitlines()]


@pytest.fixture
def publish_static(monkeypatch, ros, tmp_path):
    """
    Enter the domain of the test and an empty directory.

    :returns: a function that publishes static transforms; its arguments are pairs of frames.
    """
    monkeypatch.setenv('ROS_DOMAIN_ID', str(ros.context.get_domain_id()))
    monkeypatch.chdir(tmp_path)
    broadcaster = StaticTransformBroadcaster(ros.node)

    def publish(*edges: tuple[str, str]):
        broadcaster.sendTransform([message_of(Row(0, *edge, STILL)) for edge in edges])

    return publish


def test_labels(tmp_path):
    """They are those of tf2, except for static frames and for frames of an unknown rate."""
    lines = drawn_lines([
        dynamic('a', 'map'), static('b', 'a', '/other'),
        Frame('c', 'a', '/node', False, 1, 5 * S, 5 * S)], tmp_path)
    for line, number in (
            ('Broadcaster: /node', 2), ('Broadcaster: /other', 1), ('static', 1),
            ('Average rate: 10.000 Hz', 1), ('Average rate: unknown', 1),
            ('Buffer length: 5.000 s', 1), ('Most recent transform: 100.000000', 1),
            ('Oldest transform: 95.000000', 1), ('Recorded at time: 100.000000', 1)):
        assert lines.count(line) == number, line


def test_odd_names_are_drawn_as_they_are(tmp_path):
    """tf2 fails with some: it reads 54 as a number, on as a boolean, and rejects a: b."""
    lines = drawn_lines([static(name, 'odd "root"') for name in ODD], tmp_path)
    for name in ['odd "root"', *ODD]:
        assert set(name.split('\n')) <= set(lines), name
    assert lines.count('static') == len(ODD)


def test_several_roots_and_a_loop_are_drawn(tmp_path):
    """tf2 draws only the last root, and nothing if there is a loop."""
    frames = [static('a', 'root 1'), static('b', 'root 2'), static('x', 'y'), static('y', 'z'),
              static('z', 'x'), static('twig', 'x')]
    lines = drawn_lines(frames, tmp_path)
    names = {'a', 'root 1', 'b', 'root 2', 'x', 'y', 'z', 'twig'}
    assert names <= set(lines)
    assert as_dot(Forest(frames), 0).count('->') == 6
    forest = Forest(frames)
    assert forest.roots == ['root 1', 'root 2']
    (loop,) = forest.loops
    assert {*zip(loop, loop[1:] + loop[:1])} == {('y', 'x'), ('z', 'y'), ('x', 'z')}


def test_the_trees_in_the_terminal():
    """Rates, ages and publishers are in columns."""
    frames = [static('base', 'map'), dynamic('arm', 'base', 50), dynamic('日本', 'arm', 1),
              dynamic('wheel', 'base'), static('a', 'b'), static('b', 'a'), static('tab\t', 'b')]
    assert view_frames.format_tree(Forest(frames), 100 * S + S // 4) == [
        'map',
        '└── base             static                 /node',
        '    ├── arm         50.0 Hz    0.250 s old  /node',
        '    │   └── 日本     1.0 Hz    0.250 s old  /node',
        '    └── wheel       10.0 Hz    0.250 s old  /node',
        'b',
        '├── a                static                 /node',
        '│   └── b            static                 /node',
        '└── tab\\t            static                 /node',
    ]


def test_a_long_chain_is_drawn():
    """The chain is longer than Python's recursion limit."""
    lines = view_frames.format_tree(chain(3000), 0)
    assert len(lines) == chain(3000).line_count == 3001


def test_a_long_name_is_abbreviated_and_moves_only_its_own_line():
    """The columns of the other lines are as they would be without the long name."""
    name = f'begin{"-" * 3000}end'
    short = [static('base', 'map'), dynamic('arm', 'base')]
    lines = view_frames.format_tree(
        Forest([*short, static(name, 'map', publisher=f'/{name}')]), 100 * S)
    assert lines[:3] == [
        'map',
        '├── base        static                 /node',
        '│   └── arm    10.0 Hz    0.000 s old  /node']
    begin, _, publisher = lines[3].split()[1:]
    assert begin == f'begin{"-" * 44}...{"-" * 45}end'
    assert publisher == f'/begin{"-" * 43}...{"-" * 45}end'
    hostile = view_frames.format_tree(Forest([*short, static('\x1b' * 3000, 'map')]), 100 * S)
    assert hostile[:3] == lines[:3]


def test_the_lines_of_a_deep_tree_are_not_as_long_as_the_longest():
    """The length of a line is that of its branches plus a bounded number."""
    lines = view_frames.format_tree(chain(1000), 100 * S)
    for level, line in enumerate(lines):
        tree = 4 * min(level, 100) + len('1000 ... ') + len('1000')
        assert len(line) <= max(100, tree) + 2 + 9 + 2 + 13 + 2 + len('/node')


def test_the_branches_of_a_chain_are_cut_off():
    """From the hundredth level on, a line begins with its level; its indent grows no more."""
    first, *others = (twig.branches for twig in chain(5000).lines())
    assert first == ''
    assert others[:100] == [f'{" " * 4 * i}└── ' for i in range(100)]
    assert others[100:] == [f'{i + 1} ... {" " * 4 * 99}└── ' for i in range(100, 5000)]


def test_only_the_lines_that_a_terminal_shows_are_formatted():
    """Frames that are not shown do not widen the columns, either."""
    lines = view_frames.format_tree(chain(3000), 100 * S, 10)
    assert len(lines) == 10
    assert lines[1] == f'{"└── 1":{4 * 9 + 1}}    10.0 Hz    0.000 s old  /node'


@pytest.mark.parametrize(('output', 'files', 'begin'), [
    ('tree', {'tree.pdf', 'tree.gv'}, b'%PDF'), ('tree.svg', {'tree.svg', 'tree.gv'}, b'<?xml'),
    ('my.robot.PNG', {'my.robot.PNG', 'my.robot.gv'}, b'\x89PNG'),
    ('v1.2', {'v1.2.pdf', 'v1.2.gv'}, b'%PDF')])
def test_the_ending_says_how_to_draw(tmp_path, monkeypatch, output, files, begin):
    """The suffix of the output file is the format; the .gv file is written beside it."""
    monkeypatch.chdir(tmp_path)
    path = view_frames.output_path(output)
    view_frames.save(Forest([static('base', 'map')]), 0, path)
    assert {path.name for path in Path().iterdir()} == files
    (drawn,) = (name for name in files if not name.endswith('.gv'))
    assert str(path) == drawn
    assert path.read_bytes().startswith(begin)


def test_a_publisher_is_named_by_its_node(ros, publish_static, start, capsys):
    """Each line ends with the full name of the node that publishes the frame."""
    publish_static(('map', 'ours'))
    process = start(*tool(
        'static_transform_publisher', '--frame-id', 'map', '--child-frame-id', 'theirs',
        '--ros-args', '-r', '__node:=theirs', '-r', '__ns:=/robot'))
    process.line_with('Spinning')
    broadcaster = TransformBroadcaster(ros.node)
    for i in range(10):
        broadcaster.sendTransform(message_of(Row(i * S, 'map', 'early', STILL)))
    assert view_frames.command('no such directory/frames', LISTENING, text=True) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == 'map'
    assert {tuple(line.split()[-3:]) for line in lines[1:]} == {
        ('ours', 'static', '/test'), ('theirs', 'static', '/robot/theirs')}
    assert not [*Path().iterdir()]


def test_loops_are_reported(publish_static, capsys):
    """A loop is drawn, too; tf2 ends with exit code 0 and without a PDF."""
    publish_static(('a', 'b'), ('b', 'a'), ('map', 'base'))
    assert view_frames.command(wait_time=LISTENING) == 0
    out, err = capsys.readouterr()
    assert re.fullmatch('view_frames: warning: these frames form a loop: '
                        '(a -> b -> a|b -> a -> b)\n', err)
    assert 'frames: 4, transforms: 3, root: map' in out
    assert Path('frames.pdf').exists()


def test_no_data_is_exit_code_1_and_what_to_check(start, tmp_path):
    """No file is written; tf2 writes a PDF that says that there is no data."""
    process = start(*tool('view_frames', '-t', '0.5'), cwd=tmp_path)
    assert process.exit_code() == 1
    assert re.fullmatch(r'view_frames: no transform was received within 7 s\. .*here: 0.*'
                        r'ROS_DOMAIN_ID \(here: \d+\).*DISCOVERY_RANGE \(here: LOCALHOST\); .*\n',
                        process.output)
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(('arguments', 'message'), [
    (['-t', '0'], 'more than 0 s, .*got 0'), (['-t', '-1e-1'], 'more than 0 s, .*got -0.1'),
    (['-t', 'x'], "'x' is not a number"), (['-t', 'nan'], "'nan' is not finite"),
    (['--wait_time'], r'unrecognized arguments: --wait_time \(did you mean --wait-time\?\)'),
    (['-t', '1e300'], 'at most 1e[+]09 s, got 1e[+]300'),
    (['-o', ''], 'is not a file name'), (['-o', '..'], 'is not a file name'),
    (['-o', 'directory/'], 'is not a file name'),
    (['-o', 'a.jpg'], 'must end in .pdf, .svg, .png'),
    (['--ros-args', '-p'], 'ROS arguments')])
def test_wrong_use_is_one_line_and_exit_code_2(failed, arguments, message):
    """The line names the error."""
    code, line = failed(view_frames.main, *arguments)
    assert code == 2
    assert re.fullmatch(f'view_frames: .*{message}.*\n', line)


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    """On a full disk, there is no partial file, and an old file stays."""
    code = """if True:
        import resource, sys
        from pathlib import Path
        from dummy_arm.cli.parser import CommandError
        from dummy_arm.tools.view_frames import write
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
        write(Path('old'), b'new and short')
        try:
            write(Path('old'), bytes(2000))
        except CommandError as error:
            print(error)
    """
    done = subprocess.run([sys.executable, '-c', code], cwd=tmp_path, check=True, text=True,
                          capture_output=True)
    assert done.stdout == 'cannot write old: File too large\n'
    assert [path.name for path in tmp_path.iterdir()] == ['old']
    assert (tmp_path / 'old').read_bytes() == b'new and short'


@pytest.mark.parametrize('output', ['/proc/frames', 'missing/frames', 'directory.pdf'])
def test_where_nothing_can_be_written(monkeypatch, tmp_path, output):
    """The error says why the file cannot be written."""
    monkeypatch.chdir(tmp_path)
    Path('directory.pdf').mkdir()
    name = output.removesuffix('.pdf')
    with pytest.raises(CommandError, match=f'^cannot write {name}.pdf: .+'):
        view_frames.save(Forest([static('base', 'map')]), 0, view_frames.output_path(output))
    assert [path.name for path in Path().iterdir()] == ['directory.pdf']


def test_a_directory_that_is_not_writable_is_reported_at_once(failed):
    """The command does not listen before it checks the directory."""
    begin = time.monotonic()
    code, line = failed(view_frames.main, '-t', '100', '-o', 'missing/frames')
    assert (code, line) == (1, 'view_frames: cannot write missing/frames.pdf: missing is not a '
                               'writable directory\n')
    assert time.monotonic() < begin + 5.0


def test_sim_time_is_used(ros, publish_static, capsys):
    """Ages are relative to the time of /clock."""
    publish_static(('map', 'base'))
    broadcaster = TransformBroadcaster(ros.node)
    clock = ros.node.create_publisher(Clock, '/clock', 10)

    def publish():
        for i in range(300):
            stamp = 1000 * S + i * S // 20
            clock.publish(Clock(clock=Time(sec=stamp // S, nanosec=stamp % S)))
            broadcaster.sendTransform(message_of(Row(stamp, 'base', 'arm', STILL)))
            if ended.wait(0.05):
                return

    ended = threading.Event()
    thread = threading.Thread(target=publish)
    thread.start()
    try:
        assert view_frames.command(wait_time=LISTENING, text=True, ros_args=[
            'view_frames', '--ros-args', '-p', 'use_sim_time:=true']) == 0
    finally:
        ended.set()
        thread.join()
    (line,) = (line for line in capsys.readouterr().out.splitlines() if 'arm' in line)
    assert abs(float(line.split()[-4])) <= 2.0


def test_ros_that_does_not_start_is_exit_code_1(start):
    """This happens if an environment variable of ROS is invalid."""
    process = start('-c', 'import os; os.environ["ROS_DOMAIN_ID"] = "abc"; ' + tool(
        'view_frames')[1], '-t', '0.3')
    assert process.exit_code() == 1
    assert re.fullmatch('view_frames: .*ROS_DOMAIN_ID.*\n', process.output)


def test_an_svg_is_well_formed(tmp_path):
    """Characters that XML does not allow are escaped."""
    path = tmp_path / 'odd.svg'
    view_frames.save(Forest([
        static('\x1b[31mred', '\x00'), *(static(name, 'root') for name in ODD)]), 0, path)
    assert ElementTree.parse(path).getroot().tag.endswith('svg')


def test_each_frame_is_a_node_of_its_own():
    """This holds for names that look like escaped names, or like graphviz's own."""
    pygraphviz = pytest.importorskip('pygraphviz')
    names = ['a\n', r"'a\n'", '%3', "'%3'", '"a"', 'a']
    graph = pygraphviz.AGraph(string=as_dot(Forest([static(name, 'map') for name in names]), 0))
    assert len({*graph.nodes()}) == len({*graph.edges()}) + 1 == len(names) + 1


def test_without_pygraphviz(tmp_path, monkeypatch):
    """The .gv file is written, and the error has the remedy; tf2 exits with code 0."""
    monkeypatch.setitem(sys.modules, 'pygraphviz', None)
    with pytest.raises(CommandError, match=r'pip install pygraphviz.*; wrote .*frames\.gv$'):
        view_frames.save(Forest([static('base', 'map')]), 0, tmp_path / 'frames.pdf')
    assert '"map" -> "base"' in (tmp_path / 'frames.gv').read_text()
    assert not (tmp_path / 'frames.pdf').exists()


def test_what_the_command_refuses():
    """The arguments are checked before ROS is needed."""
    with pytest.raises(UsageError, match='more than 0 s'):
        view_frames.command(wait_time=0.0)
    with pytest.raises(UsageError, match='is not a file name'):
        view_frames.command('')


@pytest.mark.parametrize('signal_number', [signal.SIGINT, signal.SIGTERM])
def test_watch_goes_on_until_a_signal(publish_static, start, signal_number):
    """If stdout is a pipe, it prints the tree repeatedly, line by line."""
    publish_static(('map', 'base'))
    process = start(*tool('view_frames', '--watch'))
    for _ in range(2):  # before these lines, the name of the node may not be known yet
        assert process.line_with('/test').split()[-3:] == ['base', 'static', '/test']
        process.line_with('map')
    process.end(signal_number)
    assert process.exit_code() == 0
    assert 'Traceback' not in process.output


@pytest.mark.parametrize('delay', [0.1, 0.4, *(
    pytest.param(delay, marks=pytest.mark.soak) for delay in (0.2, 0.3, 0.5, 0.7, 0.9, 1.2))])
def test_ctrl_c_at_any_time_is_a_normal_end(start, tmp_path, delay):
    """It may be importing, starting, listening or drawing; no partial file is left."""
    option, code, *arguments = tool('view_frames', '-t', '0.5')
    process = start(option, BEGUN + code, *arguments, cwd=tmp_path)
    process.line_with('begun')
    time.sleep(delay)
    process.end(signal.SIGINT)
    assert process.exit_code() in (0, 1)
    assert 'Traceback' not in process.output
    assert 'ignored' not in process.output
    assert not [*tmp_path.iterdir()]


def test_a_bar_and_a_live_tree_on_a_terminal(publish_static, ros):
    """The progress bar is erased before the tree is printed."""
    publish_static(('map', 'base'))
    domain = ros.context.get_domain_id()
    bar = run_in_terminal(domain, *tool('view_frames', '--text', '-t', str(LISTENING)),
                          until=lambda _: False)
    assert 'listening to /tf and /tf_static' in bar
    assert bar.split('map\r\n')[0].count('\r') > 10
    assert '└── base' in bar.split('listening')[-1]
    live = run_in_terminal(domain, *tool('view_frames', '--watch'),
                           until=lambda written: written.count('└── base') > 1)
    assert live.count('└── base') > 1
    assert live.count('\x1b[H') > 1


def test_a_live_tree_says_how_much_of_it_is_not_shown(publish_static, ros):
    """The tree is longer than the 24 lines of the terminal."""
    publish_static(*(('map', f'frame_{i}') for i in range(30)))
    written = run_in_terminal(ros.context.get_domain_id(), *tool('view_frames', '--watch'),
                              until=lambda written: written.count('more lines') > 1)
    screen = written.split('\x1b[H\x1b[2J')[-1].splitlines()
    assert len(screen) == 23
    assert screen[-1] == '... 9 more lines (pipe the output to see all)'


def test_without_tqdm_there_is_no_bar(publish_static, ros):
    """On a terminal, the rest of the output is the same as with tqdm."""
    publish_static(('map', 'base'))
    written = run_in_terminal(
        ros.context.get_domain_id(),
        *tool_without(['tqdm'], 'view_frames', '--text', '-t', str(LISTENING)),
        until=lambda _: False)
    assert '└── base' in written
    assert 'listening' not in written
    assert 'Traceback' not in written


def test_without_tqdm_a_bag_is_read(start, tmp_path):
    """The missing module is not mentioned."""
    bags = pytest.importorskip('bags')
    bag = str(bags.make(tmp_path / 'bag', 'mcap', bags.walk()))
    process = start(*tool_without(['tqdm', *ROS], 'view_frames', '--text', '--bag', bag))
    assert process.exit_code() == 0
    assert process.output.startswith('map\n└── odom ')


@pytest.mark.parametrize(('module', 'kind', 'partial'), [
    ('mcap', 'mcap', []), ('mcap', 'mcap', ['--partial']), ('ruamel', 'db3', []),
    ('lz4', 'bag lz4', [])])
def test_without_a_reader_of_bags_a_command_says_so(start, tmp_path, module, kind, partial):
    """The error is one line with the remedy."""
    bags = pytest.importorskip('bags')
    bag = str(bags.make(tmp_path / 'bag', kind, bags.walk()))
    process = start(*tool_without([module, *ROS], 'view_frames', '--text', '--bag', bag, *partial))
    assert process.exit_code() == 1
    assert re.fullmatch(f'view_frames: .* cannot be imported .*{module}.*: pip install '
                        f'.*{module}.*\n', process.output)


def test_without_pygraphviz_a_command_says_so(start, tmp_path):
    """The error is one line with the remedy; the .gv file can be drawn elsewhere."""
    bags = pytest.importorskip('bags')
    bag = str(bags.make(tmp_path / 'bag', 'mcap', bags.walk()))
    process = start(*tool_without(['pygraphviz', *ROS], 'view_frames', '--bag', bag), cwd=tmp_path)
    assert process.exit_code() == 1
    assert re.fullmatch('view_frames: drawing needs pygraphviz, which cannot be imported .*: '
                        'pip install pygraphviz; .*; wrote frames.gv\n', process.output)
    assert (tmp_path / 'frames.gv').exists()


@pytest.mark.parametrize('kind', ['db3', 'mcap', 'bag'])
def test_a_bag_is_drawn_without_ros(start, tmp_path, kind):
    """The PDF shows the frames as they were at the end of the bag."""
    bags, pypdf = pytest.importorskip('bags'), pytest.importorskip('pypdf')
    bag = str(bags.make(tmp_path / 'robot', kind, bags.walk()))
    process = start(*tool_without_ros('view_frames', '--bag', bag), cwd=tmp_path)
    assert process.exit_code() == 0
    assert process.output == (
        'wrote frames.pdf and frames.gv: frames: 3, transforms: 2, root: map\n'
        'from 100.000000 s to 110.000000 s, 10.000 s; ages are relative to the end\n')
    text = pypdf.PdfReader(tmp_path / 'frames.pdf').pages[0].extract_text()
    publisher = '/sender' if kind == 'bag' else 'not recorded'
    for words in ('map', 'odom', 'base_link', 'static', 'Average rate: 10.000 Hz',
                  f'Broadcaster: {publisher}', 'Recorded at time: 110.000000',
                  'Most recent transform: 110.000000', 'Buffer length: 10.000 s'):
        assert words in text


def test_the_tree_of_a_bag(start, tmp_path):
    """Ages are relative to the end of the bag; --partial reads a damaged one, with a warning."""
    bags = pytest.importorskip('bags')
    bag = bags.make(tmp_path / 'robot.bag', 'bag', [
        *bags.walk(), ('/tf', 99 * bags.S, [bags.row(99 * bags.S, 'odom', 'cup')])])
    process = start(*tool_without_ros('view_frames', '--text', '--bag', str(bag)))
    assert process.exit_code() == 0
    assert process.output == (
        'map\n'
        '└── odom              static                 /sender\n'
        '    ├── base_link    10.0 Hz    0.000 s old  /sender\n'
        '    └── cup             ? Hz   11.000 s old  /sender\n'
        'from 99.000000 s to 110.000000 s, 11.000 s; ages are relative to the end\n')
    bag.write_bytes(bag.read_bytes()[:-1000])
    process = start(*tool_without_ros('view_frames', '--text', '--bag', str(bag)))
    assert process.exit_code() == 1
    assert process.output.startswith(f'view_frames: {bag} cannot be read: ')
    process = start(*tool_without_ros('view_frames', '--text', '--partial', '--bag', str(bag)))
    assert process.exit_code() == 0
    assert process.output.startswith(f'{bag}: it ends in the middle of a record. Read ')
    assert process.output.count('\n') == 6


def test_a_bag_of_a_namespace(capsys, tmp_path):
    """Without `--namespace`, the error says which namespace the bag has."""
    bags = pytest.importorskip('bags')
    bag = str(bags.make(tmp_path / 'robot', 'mcap', [
        (f'/robot{topic}', *rest) for topic, *rest in bags.walk()]))
    assert view_frames.main(['--text', '--bag', bag, '--namespace', 'robot']) == 0
    assert 'base_link' in capsys.readouterr().out
    assert view_frames.main(['--text', '--bag', bag]) == 1
    assert 'in the namespace /robot: pass it as namespace (--namespace)' in capsys.readouterr().err


@pytest.mark.parametrize(('arguments', 'code', 'why'), [
    (('--bag', 'x', '--watch'), 2, 'are for listening: leave them out'),
    (('--bag', 'x', '-t', '5'), 2, 'are for listening: leave them out'),
    (('--partial',), 2, '--partial needs --bag'),
    (('--bag', ''), 2, '--bag needs the path of a bag'),
    (('--bag', 'nowhere'), 1, 'cannot read nowhere: No such file or directory')])
def test_bags_used_wrongly(failed, monkeypatch, tmp_path, arguments, code, why):
    """The error is one line with the remedy."""
    monkeypatch.chdir(tmp_path)
    got, error = failed(view_frames.main, *arguments)
    assert got == code
    assert why in error
    assert error.count('\n') == 1


def test_a_stdout_that_has_no_lines_to_draw(start, monkeypatch, tmp_path):
    """Where stdout cannot encode box-drawing characters, as on Windows, they are replaced."""
    bags = pytest.importorskip('bags')
    bag = str(bags.make(tmp_path / 'robot', 'mcap', bags.walk()))
    monkeypatch.setenv('PYTHONIOENCODING', 'cp1252')
    process = start(*tool_without_ros('view_frames', '--text', '--bag', bag))
    assert process.exit_code() == 0
    assert 'base_link' in process.output
    assert 'Traceback' not in process.output


def large_bag(path, count):
    """Write a bag of a random tree; with 4000 frames, graphviz takes half a minute to draw it."""
    bags = pytest.importorskip('bags')
    generator = random.Random(1)
    return str(bags.make(path / 'large', 'mcap', [('/tf_static', 0, [
        bags.row(0, f'f{generator.randrange(i + 1)}', f'f{i + 1}') for i in range(count - 1)])]))


def stand_in(path, draw):
    """Write a stand-in for pygraphviz; return the environment variable that makes it found."""
    path.mkdir()
    (path / 'pygraphviz.py').write_text(
        'import os, subprocess, time\n'
        'time.sleep(0.2)  # the import of pygraphviz takes as long\n'
        'class AGraph:\n'
        '    def __init__(self, string):\n'
        '        self.string = string\n'
        '    def draw(self, format, prog):\n'
        f'        {draw}\n')
    paths = [str(path), os.environ.get('PYTHONPATH')]
    return {'PYTHONPATH': os.pathsep.join(filter(None, paths))}


def seconds_of_work(pid):
    """Return the CPU time that a process has used (s)."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return int(fields[11]) / os.sysconf('SC_CLK_TCK')


#: The code of the command, without its limit of the number of frames.
UNLIMITED = ('import dummy_arm.tools.view_frames as v; v.MAX_FRAMES = 10**6; '
             + tool('view_frames')[1])


@pytest.mark.parametrize('signal_number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('is_real', [True, False])
def test_a_signal_ends_the_drawing(start, tmp_path, signal_number, is_real):
    """All its processes end, such as dot, which pygraphviz 1.11 starts; no file is written."""
    bag = large_bag(tmp_path, 4000)
    environment = {} if is_real else stand_in(
        tmp_path / 'modules', 'subprocess.run(["sleep", "100"])')
    there = tmp_path / 'there'
    there.mkdir()
    # The real pygraphviz starts to draw within a second, and takes half a minute.
    process = start('-c', UNLIMITED, '--bag', bag, cwd=there, environment=environment)
    deadline = time.monotonic() + 2 * TIMEOUT
    while not ((drawing := process.descendants()) and (
            sum(map(seconds_of_work, drawing)) > 1.0 if is_real else len(drawing) > 1)):
        assert not process.has_ended(), process.output
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.end(signal_number)
    assert process.exit_code() == 0
    deadline = time.monotonic() + TIMEOUT
    while any(map(is_running, drawing)):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert process.output == ''
    assert not [*there.iterdir()]


def test_a_kill_ends_the_drawing_too(start, kill, tmp_path):
    """Otherwise the drawing would go on for half a minute, as after its terminal is closed."""
    process = start('-c', UNLIMITED, '--bag', large_bag(tmp_path, 4000), cwd=tmp_path)
    deadline = time.monotonic() + 2 * TIMEOUT
    while not (drawing := process.descendants()) or sum(map(seconds_of_work, drawing)) < 1.0:
        assert not process.has_ended(), process.output
        assert time.monotonic() < deadline
        time.sleep(0.01)
    kill(process)
    deadline = time.monotonic() + 5.0
    while any(map(is_running, drawing)):
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_graph_that_is_larger_than_a_pipe(monkeypatch, tmp_path):
    """It is drawn, although the drawing process does not read it at once."""
    stand_in(tmp_path / 'modules', 'return f"{len(self.string)}".encode()')
    monkeypatch.syspath_prepend(tmp_path / 'modules')
    dot = as_dot(chain(10_000), 0)
    assert len(dot) > 10 * 2**16
    assert draw(dot, 'pdf') == f'{len(dot)}'.encode()


@pytest.mark.parametrize(('drawing', 'why'), [
    ('raise OSError("no format pdf")', 'OSError: no format pdf'),
    ('os.write(2, b"\\nFontconfig warning\\nError: trouble\\n"); os._exit(1)', 'Error: trouble'),
    ('return b""', 'exit code 0'), ('os.abort()', 'exit code -6')])
def test_graphviz_that_fails(failed, monkeypatch, tmp_path, drawing, why):
    """The error has the last line of graphviz; the .gv file can be drawn elsewhere."""
    bags = pytest.importorskip('bags')
    bag = str(bags.make(tmp_path / 'bag', 'mcap', bags.walk()))
    stand_in(tmp_path / 'modules', drawing)
    monkeypatch.syspath_prepend(tmp_path / 'modules')
    (tmp_path / 'there').mkdir()
    monkeypatch.chdir(tmp_path / 'there')
    assert failed(view_frames.main, '--bag', bag) == (
        1, f'view_frames: graphviz cannot draw this: {why}; wrote frames.gv\n')
    assert [path.name for path in Path().iterdir()] == ['frames.gv']


def test_warnings_of_graphviz_are_not_shown(capfd, monkeypatch, tmp_path):
    """For example, fontconfig may print warnings."""
    stand_in(tmp_path / 'modules', 'os.write(2, b"warning"); return format.encode()')
    monkeypatch.syspath_prepend(tmp_path / 'modules')
    assert draw(as_dot(chain(1), 0), 'svg') == b'svg'
    assert capfd.readouterr() == ('', '')


def test_modules_of_the_working_directory_do_not_draw(start, tmp_path):
    """Neither the command nor the process that draws imports them."""
    bag = large_bag(tmp_path, 3)
    there = tmp_path / 'there'
    there.mkdir()
    for name in 'pygraphviz.py', 'dummy_arm.py', 'subprocess.py', 'ctypes.py':
        (there / name).write_text('raise SystemExit("found where it should not")\n')
    script = tmp_path / 'view_frames'
    script.write_text(tool('view_frames')[1])
    process = start(str(script), '--bag', bag, cwd=there)
    assert process.exit_code() == 0
    assert process.output.startswith('wrote frames.pdf and frames.gv: frames: 3, ')


def test_more_frames_than_can_be_drawn(failed, monkeypatch, tmp_path):
    """The error is immediate and has the remedy; the .gv file can be drawn elsewhere."""
    bag = large_bag(tmp_path, 2001)
    there = tmp_path / 'there'
    there.mkdir()
    monkeypatch.chdir(there)
    code, line = failed(view_frames.main, '--bag', bag)
    assert (code, line) == (1, 'view_frames: 2001 frames are too many to draw; the limit is 2000: '
                               'draw a part with --root FRAME, or print the tree with --text; '
                               'wrote frames.gv\n')
    assert [path.name for path in there.iterdir()] == ['frames.gv']
    assert Path('frames.gv').read_text().count('->') == 2000
    assert view_frames.main(['--bag', bag, '--root', 'f1000']) == 0
    assert Path('frames.pdf').exists()


@pytest.fixture
def house(tmp_path):
    """A bag with a tree, a loop, and branches that end at different times."""
    bags = pytest.importorskip('bags')
    return str(bags.make(tmp_path / 'house', 'mcap', [
        *bags.walk(seconds=10), *(('/tf', time, [bags.row(time, *edge)]) for time, edge in (
            (102 * S, ('base_link', 'arm')), (104 * S, ('base_link', 'arm')),
            (104 * S, ('arm', 'tool')), (104 * S, ('x', 'y')), (104 * S, ('y', 'z')),
            (104 * S, ('z', 'x')), (104 * S, ('y', 'twig'))))]))


@pytest.mark.parametrize(('root', 'tree', 'span'), [
    ('/base_link', ['base_link', '└── arm', '    └── tool'],
     'from 102.000000 s to 104.000000 s, 2.000 s; '
     'ages are relative to the end of the bag, 110.000000 s'),
    ('odom', ['odom', '└── base_link', '    └── arm', '        └── tool'],
     'from 100.000000 s to 110.000000 s, 10.000 s; ages are relative to the end'),
    ('tool', ['tool'], 'all transforms are static')])
def test_the_tree_below_a_root(capsys, house, root, tree, span):
    """There is no warning of a loop elsewhere; ages are relative to the end of the whole bag."""
    assert view_frames.main(['--text', '--bag', house, '--root', root]) == 0
    out, err = capsys.readouterr()
    *lines, last = out.splitlines()
    assert [re.sub(' +[0-9?.]+ Hz.*', '', line) for line in lines] == tree
    assert ('6.000 s old' in out) == (root != 'tool')
    assert last == span
    assert err == ''


def test_the_drawing_below_a_root(capsys, house, monkeypatch, tmp_path):
    """The root may have no descendants."""
    monkeypatch.chdir(tmp_path)
    for root, message, edges in (('base_link', 'frames: 3, transforms: 2, root: base_link\n', 2),
                                 ('tool', 'frames: 1, transforms: 0, root: tool\n', 0)):
        assert view_frames.main(['-o', root, '--bag', house, '--root', root]) == 0
        assert f'{root}.gv: {message}' in capsys.readouterr().out
        graph = Path(f'{root}.gv').read_text()
        assert graph.count('->') == edges
        assert f'"{root}" [label' in graph
        assert 'odom' not in graph
        assert Path(f'{root}.pdf').read_bytes().startswith(b'%PDF')


@pytest.mark.parametrize('root', ['x', 'y', 'z'])
def test_a_root_in_a_loop(capsys, house, root):
    """The loop begins and ends with the root, and causes a warning; its branches are shown."""
    assert view_frames.main(['--text', '--bag', house, '--root', root]) == 0
    out, err = capsys.readouterr()
    names = re.findall(r'(\w+)(?: +\? Hz.*)?\n', out)[:-1]
    assert names[0] == root
    assert sorted(names) == sorted([root, 'x', 'y', 'z', 'twig'])
    assert re.fullmatch('view_frames: warning: these frames form a loop: .*\n', err)


@pytest.mark.parametrize(('root', 'code', 'message'), [
    ('base_lnk', 1, "frame 'base_lnk' does not exist. Nearest known: 'base_link'."),
    ('', 2, '--root needs the name of a frame'), ('/', 2, '--root needs the name of a frame')])
def test_a_root_that_does_not_exist(failed, house, root, code, message):
    """The error is one line with the nearest names."""
    assert failed(view_frames.main, '--text', '--bag', house, '--root', root) == (
        code, f'view_frames: {message}\n')


def test_a_live_tree_waits_for_its_root(publish_static, start):
    """Until the root exists, a line says that it is missing."""
    publish_static(('map', 'base'))
    process = start(*tool('view_frames', '--watch', '--root', 'tool'))
    process.line_with("waiting for the root: frame 'tool' does not exist. Known frames: "
                      "'map', 'base'.")
    publish_static(('base', 'tool'), ('tool', 'tip'))
    while process.line_with('t') != 'tool\n':
        pass
    assert process.line().startswith('└── tip ')
    assert process.line() == '\n'


def test_a_long_chain_below_a_root():
    """The chain is longer than Python's recursion limit."""
    tree = chain(3000).subtree('1000')
    assert [*tree.names] == [f'{i}' for i in range(1000, 3001)]
    assert tree.roots == ['1000']
