"""Commands that cannot begin: one line that says why."""

from collections.abc import Sequence
from importlib import import_module
import shlex

import pytest

#: By command and part of the error: the arguments.
WRONG: dict[str, dict[str, Sequence[str]]] = {
    'check_arm': {
        'give files of programs, or --bag, or --frames': [
            'a.py --bag b', '--frames f.pdf --bag b'],
        '--time is for programs and the arm that is running, not for a bag': ['--bag b --time 9'],
        'the time to listen must be more than 0 s': ['--time 0'],
        "'nan' is not finite": ['--time nan'],
        '--jobs must be at least 1, got 0': ['a.py --jobs 0'],
        'is for programs, not for the arm that is running': ['--jobs 2', '--csv out.csv'],
        '--feedback is for programs and': ['--feedback d --bag b', '--feedback d --frames f.pdf'],
        '--namespace is for a bag and the arm': ['a.py --namespace robot'],
        "--csv needs the name of a file that ends in .csv, got 'b.py'": ['a.py --csv b.py'],
        '--csv needs the name of a file that ends in .csv': ['a.csv --csv a.csv']},
    'tf2_echo': {
        'the following arguments are required: target_frame': ['map'],
        'a frame must have a name': ['map /', "'' odom"],
        "'fast' is not a number": ['map odom fast'],
        'the rate must be more than 0 Hz, got 0': ['map odom 0'],
        'the rate must be more than 0 Hz, got -0.001': ['map odom -r -1e-3'],
        'the rate is given twice': ['map odom 1 -r 1'],
        'the precision must be from 0 to 17 digits, got 18': ['map odom -p 18'],
        'the precision must be from 0 to 17 digits, got -1': ['map odom -p -1'],
        "invalid int value: '0.5'": ['map odom -p 0.5'],
        'it needs --bag': ['map odom -t -1'],
        "'1e99' must be a time, such as": ['map odom -t 1e99'],
        'with at most 9 digits after the point': [
            f'map odom -t 1.{"0" * 30}1', 'map odom -t 1.0000000001'],
        'leave out the rate': ['map odom --bag x -r 1']},
    'tf2_monitor': {
        'give two frames, or none to monitor all frames': ['map'],
        'a frame must have a name': ["map ''", '/ odom']},
    'tf_doctor': {
        'or none to check everything': ['map', 'x.mcap --bag y.mcap'],
        "or none to check everything; 'no_bag' is no bag": ['--bag x no_bag'],
        "'c' and 'd' are no bags, and frames need one recording": ['--bag a.mcap b.mcap c d'],
        'a frame must have a name': ['map /'],
        '-t needs two frames': ['-t 5'],
        "unknown code 'gaps'. Nearest known: 'gap'": ['--ignore gaps'],
        'more than 0 s': ['--time 0'],
        '--jobs must be at least 1, got 0': ['--bag x --jobs 0'],
        '--jobs is for examining bags': ['--jobs 2'],
        "no section explains 'one_shoot'. Nearest known: 'one_shot'.": ['--explain one_shoot'],
        "Nearest known: 'two_trees'.": ['--explain two_tree']},
    'tf_trajectory': {
        'the following arguments are required: source_frame': ['map'],
        'a frame must have a name': ["map ''", '/ odom'],
        "'x' must end in .csv, .tum, .npz, .png, .svg, .pdf": ['map odom -o x'],
        "'' must end in .csv": ["map odom -o ''"],
        "'.csv' must end in .csv": ['map odom -o .csv'],
        "'x.csv/' must end in .csv": ['map odom -o x.csv/'],
        "'x.json' must end in .csv": ['map odom -o x.json'],
        'a .tum file has no place for velocities': ['map odom -o x.tum --twist'],
        'must be a time in s, from 0 to 9223372036, with at most 9 digits': [
            f'map odom --every {every}' for every in ('-1', '1e-10', '1e10', 'nan')],
        '--every must be more than 0 s': ['a b --bag x --every 0'],
        'give either --at or --every': ['a --bag x --at /scan --every 1'],
        '--start, --stop, --at and --topic need --bag': [
            'a b --start 1', 'a b --stop 5', 'a b --at /scan', '--topic /x'],
        'with --topic, leave out the frames and --at': [
            '--bag x --topic /x a', '--bag x --topic /x --at /y']},
    'view_frames': {
        'the time to listen must be more than 0 s, and at most 1e+09': ['-t 0', '-t 1e300'],
        'unrecognized arguments: --wait_time (did you mean --wait-time?)': ['--wait_time'],
        'must end in .pdf, .svg, .png': ['-o a.jpg', "-o ''", '-o ..', '-o directory/'],
        'a frame must have a name': ["--root ''", '--root /'],
        'is for listening: leave it out': ['--bag x --watch', '--bag x -t 5']},
    'web_view': {
        'from 1 to 65535': [f'--port={port}' for port in (
            '0', '-1', '65536', '8080.0', '80_80', "' 80'", '', 'http', '٣', '9' * 5000)],
        "there is no directory 'no/where'": ['--meshes . --meshes no/where'],
        "'a.pdf' must end in .html": ['--export a.pdf'],
        '--time needs --export': ['--time 3'],
        'the time to listen must be more than 0 s': ['--export a.html --time 0']}}


def main_of(command):
    """Return the function of a command."""
    package = 'dummy_arm' if command == 'check_arm' else 'puretf_tools.commands'
    return import_module(f'{package}.{command}').main


@pytest.mark.parametrize(('command', 'arguments', 'text'), [
    pytest.param(command, arguments, text, id=f'{command} {arguments}'[:60])
    for command, rows in WRONG.items() for text, given in rows.items() for arguments in given])
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
