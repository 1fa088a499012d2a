"""Commands that cannot begin: one line that says why."""

from importlib import import_module
import shlex

import pytest

#: By command: arguments, and a part of the error.
WRONG = {
    'check_arm': [
        ('a.py --bag b', 'give files of programs, or --bag, or --frames'),
        ('--frames f.pdf --bag b', 'give files of programs, or --bag, or --frames'),
        ('--bag b --time 9', '--time is for an arm that is running'),
        ('--time 0.5', '--time must be at least 1 s, and at most 3600 s, got 0.5'),
        ('--time nan', "'nan' is not finite"),
        ('a.py --jobs 0', '--jobs must be at least 1, and at most 17, got 0'),
        ('--jobs 2', '--csv, --feedback and --jobs need the files'),
        ('--csv out.csv', '--csv, --feedback and --jobs need the files'),
        ('a.py --resume', '--resume needs --csv'),
        ('a.py a.py', 'a.py is given twice'),
        ("'a\x1b' 'a\\x1b'", r'a\x1b is given twice'),
        ('a.py --namespace robot', '--namespace is for --bag'),
        ('a.py --csv b.py', "--csv needs the name of a file that ends in .csv, got 'b.py'"),
        ('a.csv --csv a.csv', '--csv needs the name of a file that ends in .csv'),
        ('--partial', '--partial needs --bag'),
        ("--bag ''", '--bag needs the path of a bag'),
        ('--frames frames.txt', "'frames.txt' must end in .pdf or .gv")],
    'tf2_echo': [
        ('map', 'the following arguments are required: target_frame'),
        ('map /', 'a frame must have a name'),
        ("'' odom", 'a frame must have a name'),
        ('map odom fast', "'fast' is not a number"),
        ('map odom 0', 'the rate must be more than 0 Hz, got 0'),
        ('map odom -r -1e-3', 'the rate must be more than 0 Hz, got -0.001'),
        ('map odom 1 -r 1', 'the rate is given twice'),
        ('map odom -p 18', 'the precision must be from 0 to 17 digits, got 18'),
        ('map odom -p -1', 'the precision must be from 0 to 17 digits, got -1'),
        ('map odom -p 0.5', "'0.5' is not a whole number"),
        ('map odom -t -1', "'-1' must be a time in s"),
        ('map odom -t 1e99', "'1e99' must be a time in s"),
        (f'map odom -t 1.{"0" * 30}1', 'with at most 9 digits after the point'),
        ('map odom -t 1.0000000001', 'with at most 9 digits after the point'),
        ('map odom --bag x -r 1', 'leave out the rate'),
        ('map odom --partial', '--partial needs --bag')],
    'tf2_monitor': [(frames, 'give two frames, or none to monitor all frames')
                    for frames in ('map', "map ''", '/ odom')],
    'tf_trajectory': [
        ('map', 'the following arguments are required: source_frame'),
        ("map ''", 'a frame must have a name'),
        ('/ odom', 'a frame must have a name'),
        ('map odom -o x', "'x' must end in .csv, .tum, .npz, .png, .svg, .pdf"),
        ("map odom -o ''", "'' must end in .csv"),
        ('map odom -o .csv', "'.csv' must end in .csv"),
        ('map odom -o x.csv/', "'x.csv/' must end in .csv"),
        ('map odom -o x.json', "'x.json' must end in .csv"),
        ('map odom -o x.tum --twist', 'a .tum file has no place for velocities'),
        ('map odom --every 0', '--every must be at least 1e-09 s'),
        ('map odom --every -1', '--every must be at least 1e-09 s'),
        ('map odom --every 1e-10', '--every must be at least 1e-09 s'),
        ('map odom --every 1e10', '--every must be at least 1e-09 s, and less than'),
        ('map odom --every nan', "'nan' is not finite"),
        ('map odom --time 0', 'the time to listen must be more than 0 s'),
        ('map odom --time 1e10', 'and at most 1e+09 s, got 1e+10'),
        ('map odom --bag x --time 1', 'leave it out with --bag'),
        ("map odom --bag ''", '--bag needs the path of a bag'),
        ('map odom --partial', '--partial needs --bag')],
    'view_frames': [
        ('-t 0', 'the time to listen must be more than 0 s, and at most 1e+09 s, got 0'),
        ('-t x', "'x' is not a number"),
        ('--wait_time', 'unrecognized arguments: --wait_time (did you mean --wait-time?)'),
        ('-t 1e300', 'at most 1e+09 s, got 1e+300'),
        ("-o ''", 'is not a file name'), ('-o ..', 'is not a file name'),
        ('-o directory/', 'is not a file name'),
        ('-o a.jpg', 'must end in .pdf, .svg, .png'),
        ("--root ''", '--root needs the name of a frame'),
        ('--root /', '--root needs the name of a frame'),
        ('--bag x --watch', 'are for listening: leave them out'),
        ('--bag x -t 5', 'are for listening: leave them out'),
        ('--partial', '--partial needs --bag'),
        ("--bag ''", '--bag needs the path of a bag')],
    'web_view': [
        *((f'--port={port}', 'from 1 to 65535') for port in (
            '0', '-1', '65536', '8080.0', '80_80', "' 80'", '', 'http', '٣', '9' * 5000)),
        ('--meshes . --meshes no/where', "there is no directory 'no/where'"),
        ('--export a.pdf', "'a.pdf' must end in .html"),
        ('--time 3', '--time needs --export'),
        ('--export a.html --time 0', 'the time to listen must be more than 0 s')]}


def main_of(command):
    """Return the function of a command."""
    package = 'dummy_arm' if command == 'check_arm' else 'puretf_tools.commands'
    return import_module(f'{package}.{command}').main


@pytest.mark.parametrize(('command', 'arguments', 'text'), [
    pytest.param(command, arguments, text, id=f'{command} {arguments}'[:60])
    for command, rows in WRONG.items() for arguments, text in rows])
def test_wrong_use(failed, command, arguments, text):
    """The exit code is 2."""
    code, error = failed(main_of(command), *shlex.split(arguments))
    assert code == 2
    assert text in error
    assert error.startswith(f'{command}: ')
    assert error.count('\n') == 1


@pytest.mark.parametrize(('command', 'arguments', 'name'), [
    ('tf_trajectory', 'map odom -o', 'x.csv'), ('view_frames', '-o', 'x.pdf'),
    ('web_view', '--export', 'x.html')])
def test_where_nothing_can_be_written(failed, tmp_path, command, arguments, name):
    """The exit code is 1; the error comes before the bag is read, and no file is written."""
    path = tmp_path / 'missing' / name
    assert failed(main_of(command), '--bag', 'nowhere', *arguments.split(), str(path)) == (
        1, f'{command}: cannot write {path}: {path.parent} is not a writable directory\n')
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(('command', 'arguments'), [
    ('check_arm', ''), ('tf2_echo', 'map odom'), ('tf_trajectory', 'map odom'),
    ('view_frames', ''), ('web_view', '')])
def test_a_bag_that_does_not_exist(failed, command, arguments):
    """The exit code is 1."""
    assert failed(main_of(command), *arguments.split(), '--bag', 'nowhere') == (
        1, f'{command}: cannot read nowhere: No such file or directory\n')
