"""What all commands with ROS share: how nodes and commands end, by themselves and by signals."""

from importlib import import_module
import re
import signal
import subprocess
import sys

from cli_runner import call
from environment import DATA
from processes import tool
import pytest
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

from puretf._ros.rclpy_private import RCLError
from puretf_tools.cli import node
from puretf_tools.cli.node import ros_context, run_node, spinning_node
from puretf_tools.cli.parser import Parser, run


def command_of(command):
    """Return the `main` of a command."""
    return lambda args: run(Parser('tool', ''), command, args)


def fail():
    """Fail as a callback of a node."""
    raise ZeroDivisionError('of a callback')


def test_a_command_ends_when_its_node_stops(domain_id):
    """It prints one line: its further output would be out of date."""
    def make():
        node = Node('tool')
        node.create_timer(0.01, fail)
        return node

    assert call(command_of(lambda ros_args: run_node(make, ros_args)), domain=domain_id) == (
        1, '', 'tool: the node stopped, because its executor raised ZeroDivisionError: '
               'of a callback\n')


def test_ctrl_c_ends_a_node(domain_id):
    """It has the name of the command. A second signal, as make sends it, leaves nothing of it."""
    nodes, destroyed = [], []

    def prepare(node):
        def destroy():
            signal.raise_signal(signal.SIGTERM)
            destroyed.append(Node.destroy_node(node))

        node.destroy_node = destroy
        node.create_timer(0.01, lambda: print(node.get_name()))
        nodes.append(node)
        return node

    def command(ros_args):
        return run_node(lambda: prepare(Node('tool')), ros_args)

    result = call(command_of(command), '--ros-args', '-r', '__node:=named', domain=domain_id,
                  until=lambda text: text.count('named\n') > 2)
    assert (result.code, result.stderr) == (0, '')
    assert len(destroyed) == 1
    with pytest.raises(InvalidHandle):
        nodes[0].handle.__enter__()


@pytest.mark.parametrize(('arguments', 'text'), [
    (('--ros-args', '-p', 'use_sim_time:=7'), '.*use_sim_time.*'),
    (('--ros-args', '-p', 'rate'), ".*'-p rate'.*"),
    (('--ros-args', '--nonsense'), r"unknown ROS arguments: \['--nonsense'\]"),
    (('--ros-args', '-r', '__node:=\udcff'),
     r"the argument '__node:=\\udcff' must be valid Unicode")])
def test_bad_ros_arguments(domain_id, arguments, text):
    """The error is one line, without locations in the source code of rcl."""
    result = call(command_of(lambda ros_args: run_node(lambda: Node('tool'), ros_args)),
                  *arguments, domain=domain_id)
    assert result.code == 2
    assert re.fullmatch(f'tool: {text}\n', result.stderr)
    assert not re.search(r'\.c(pp)?:\d', result.stderr)


def test_a_domain_that_cannot_be(domain_id):
    """ROS cannot be initialised."""
    def command(ros_args):
        with ros_context(ros_args):
            return 0

    code, _, error = call(command_of(command), domain=10**20)
    assert code == 1
    assert re.fullmatch(r'tool: .*ROS_DOMAIN_ID.*\n', error)
    assert call(command_of(command), domain=domain_id).code == 0


def test_a_node_that_cannot_be_created(domain_id, monkeypatch):
    """One line points at those of the middleware, which rcl does not repeat."""
    def create_node():
        raise RCLError('error creating node, at ./src/rcl/node.c:263')

    def command(ros_args):
        return run_node(create_node, ros_args)

    monkeypatch.setattr(node, 'get_rmw_implementation_identifier', lambda: 'rmw_x')
    assert call(command_of(command), domain=domain_id) == (
        1, '', 'tool: cannot create the node: error creating node. Lines above may be from '
               'rmw_x, and say why\n')


def test_a_shutdown_of_the_context_ends_a_node(start):
    """It is a normal end, although the domain of the node is not known any more."""
    process = start('-c', """if True:
        import rclpy
        from rclpy.node import Node
        from puretf_tools.cli.node import run_node

        class Ending(Node):
            def __init__(self):
                super().__init__('ending')
                self.create_timer(0.01, rclpy.shutdown)

        print('exit code', run_node(Ending, ['tool']))
        """)
    process.line_with('exit code')
    assert process.exit_code() == 0
    assert process.output == 'exit code 0\n'


@pytest.mark.parametrize(('command', 'module', 'number', 'code'), [
    ('dummy_arm', 'numpy.', signal.SIGINT, 0), ('param', 'rclpy.', signal.SIGTERM, 0),
    ('check_arm', 'puretf.', signal.SIGINT, 1),
    ('view_frames --bag=SPLIT', 'numpy.', signal.SIGTERM, 143)])
def test_a_signal_while_a_command_is_imported(start, command, module, number, code):
    """No traceback is printed from within an import, during which the signal arrives."""
    if '--bag' in command:
        pytest.importorskip('rosbags')  # without it, an error ends the command sooner
    name, *arguments = command.replace('SPLIT', str(DATA / 'split')).split()
    option, tool_code, *arguments = tool(name, *arguments)
    process = start(option, f"""if True:
        import os, sys

        class Sender:
            @staticmethod
            def find_spec(name, *_):
                if name.startswith({module!r}):
                    sys.meta_path.remove(Sender)
                    print('signal', flush=True)
                    os.kill(os.getpid(), {number:d})

        sys.meta_path.insert(0, Sender)
        {tool_code}
        """, *arguments)
    assert process.exit_code() == code
    assert process.output.startswith('signal\n')
    assert 'Traceback' not in process.output


@pytest.fixture(scope='module')
def walk(tmp_path_factory):
    """The path of a bag that is read in some tenths of a second."""
    bags = pytest.importorskip('bags')
    return str(bags.make(tmp_path_factory.mktemp('bags') / 'walk.bag', 'bag', bags.walk(3000)))


WITH_BAG = ['tf2_echo map odom', 'tf_doctor', 'tf_doctor map odom',
            'tf_trajectory map base_link -o x.csv', 'view_frames', 'web_view --export x.html']


@pytest.mark.parametrize('command', ['tf_doctor', 'web_view --export x.html'])
def test_a_signal_in_a_loop_that_does_not_check_for_it(tmp_path, start, walk, command):
    """It ends the command after some seconds, wherever in the reading of a bag the loop is."""
    name, *arguments = command.split()
    option, code = tool(name, *arguments, '--bag', walk)[:2]
    process = start(option, (
        'import puretf._bag.files as files\n'
        'def read_for_ever(path, contents):\n'
        '    print("begun", flush=True)\n'
        '    while True:\n'
        '        pass\n'
        'files._FORMATS[b"#ROSBAG V"] = read_for_ever\n' + code), *arguments, '--bag', walk,
        cwd=tmp_path)
    process.line_with('begun')
    process.end(signal.SIGTERM)
    assert process.exit_code() == 128 + signal.SIGTERM
    assert process.output == f'begun\n{name}: ended early by SIGTERM\n'


@pytest.mark.parametrize('command', WITH_BAG)
def test_ctrl_c_while_a_bag_is_read(tmp_path, monkeypatch, walk, command):
    """The exit code is that of a shell, since there is no result; one line says so."""
    monkeypatch.chdir(tmp_path)
    name, *arguments = command.split()
    main = import_module(f'puretf_tools.commands.{name}').main
    code, output, error = call(main, *arguments, '--bag', walk, columns=80,
                               until=lambda text: 'reading walk.bag' in text)
    assert code == 130
    assert output == ''
    assert error.endswith(f'{name}: ended early by SIGINT\r\n')
    assert not [*tmp_path.iterdir()]


def test_a_shutdown_that_hangs_is_cut_short(start):
    """Fast DDS may hang in it with the GIL held: no Python code runs, and no signal handler."""
    process = start('-c', """if True:
        import ctypes, sys
        from dummy_arm import entry_points
        from puretf_tools.cli import node, signals

        signals._LONGEST_END = 1
        node.destroy = lambda node: ctypes.PyDLL(None).pause()
        sys.exit(entry_points.dummy_arm())
        """)
    process.line_with('publishing map -> base_link')
    process.press_ctrl_c()
    assert process.exit_code() == 1
    assert 'Timeout (0:00:01)!' in process.output
    assert 'in spinning_node' in process.output


def test_unfinished_ports_are_named(domain_id, monkeypatch):
    """A line says which file was removed, or cannot be; the command goes on."""
    lines = 'removed /dev/shm/fastrtps_port1', 'cannot remove /dev/shm/fastrtps_port2'
    monkeypatch.setattr(node, 'remove_unfinished_ports', lambda: iter(lines))

    def command(ros_args):
        with spinning_node('tool', ros_args):
            return 0

    assert call(command_of(command), domain=domain_id) == (
        0, '', f'tool: warning: {lines[0]}\ntool: warning: {lines[1]}\n')


@pytest.mark.parametrize(('command', 'code'), [('tf2_echo', 0), ('check_arm', 1)])
def test_a_closed_pipe_is_no_error(tmp_path, command, code):
    """Only check_arm has an exit code that would be wrong if not all is printed."""
    bags = pytest.importorskip('bags')
    bag = str(bags.make(tmp_path, 'bag', bags.walk(1)))
    frames = ['map', 'odom'] if command == 'tf2_echo' else []
    with subprocess.Popen([sys.executable, *tool(command, '--bag', bag, *frames)],
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b''
        assert process.wait() == code
