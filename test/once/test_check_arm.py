"""check_arm runs programs, judges their arms, and leaves none running."""

import signal

from hand_ins import CHAOS, differences, MISTAKES, MODEL_ANSWER, program, read_table
from processes import is_running, tool
import pytest
from ros_node import eventually

#: What loads the machine most; test/long runs these, too.
HEAVY = 'floods.py', 'fork_bomb.py', 'large_file.py', 'memory_hog.py', 'one_large_array.py'


def test_programs(start, tmp_path):
    """Each program gets its line, and a row of the table, in the order of the arguments."""
    programs = {'model.py': MODEL_ANSWER, **{
        name: hand_in for name, hand_in in {**MISTAKES, **CHAOS}.items() if name not in HEAVY}}
    for name, hand_in in programs.items():
        hand_in.write(tmp_path / name)
    process = start(*tool('check_arm', *programs, '--csv', 'grades.csv', '--feedback', 'feedback',
                          '--jobs', '8'), cwd=tmp_path)
    assert process.exit_code(600.0) == 1
    table = tmp_path / 'grades.csv'
    assert not differences(programs, process.output, table)
    assert not process.has_left_processes()
    rows = {row['file']: row for row in read_table(table)}
    assert [*rows['model.py'].values()] == ['model.py', 'ok', '', 'missing', *['ok'] * 33]
    assert rows['full_angle.py']['joint_1 stays within ±45°'] == 'not ok'
    assert f'full_angle.py: not ok: {rows["full_angle.py"]["reason"]}\n' in process.output
    assert {path.name for path in tmp_path.iterdir()} == {
        'grades.csv', 'feedback', *programs.keys() - {'missing.py'}}
    assert {path.stem for path in (tmp_path / 'feedback').rglob('*.txt')
            if '\npassed: ' in path.read_text()} == {
                name for name, row in rows.items() if row['verdict'] == 'ok'}


def test_a_program_in_a_package(start, tmp_path):
    """It can import from its package, as with `ros2 run`, or what lies beside it."""
    folders = {f'ws {module}/src/dummy_arm/dummy_arm': module for module in (
        '.tools', 'dummy_arm.tools', 'tools')}
    # A folder with another name is no package, whatever is in it.
    for folder, module in {**folders, 'math': 'tools', 'tools': 'tools'}.items():
        package = tmp_path / folder
        package.mkdir(parents=True)
        (package / '__init__.py').touch()
        (package / 'tools.py').write_text('HALF = 0.5\n')
        (package / 'dummy_arm.py').write_text(program(
            ('import rclpy\n', f'import rclpy\n\nfrom {module} import HALF\n'),
            ("\n\nif __name__ == '__main__':\n    main()\n", '\n')))
    names = ['..', *(f'../../{path.name}' for path in tmp_path.iterdir())]
    (package / 'sub').mkdir()
    process = start(*tool('check_arm', '--jobs', '6', *names), cwd=package / 'sub')
    assert process.exit_code(120.0) == 0
    assert sorted(process.output.splitlines()) == sorted(f'{name}: ok' for name in names)


ENDLESS = """import os, signal, subprocess, sys, time
from pathlib import Path
signal.signal(2, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(1000)'],
                         start_new_session=True)
path = Path(os.environ['PIDS'], Path(sys.argv[0]).name).with_suffix('.pid')
path.write_text(f'{os.getpid()} {child.pid} end')
time.sleep(1000)
"""


def started_pids(path):
    """Wait until a program has written its process ids, and return them."""
    eventually(lambda: path.exists() and path.read_text().endswith('end'))
    return [int(word) for word in path.read_text().split()[:-1]]


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGKILL])
def test_an_end_of_check_arm_leaves_no_program(start, tmp_path, number):
    """Nor their children and copies. What was judged is in the table."""
    for name, code in ('first.py', ENDLESS), ('fast.py', '1 / 0'), ('last.py', ENDLESS):
        (tmp_path / name).write_text(code)
    process = start(*tool('check_arm', 'first.py', 'fast.py', 'last.py', '--csv', 'grades.csv',
                          '--jobs', '2'), cwd=tmp_path, environment={
        'PIDS': str(tmp_path), 'TMPDIR': str(tmp_path)})
    pids = [*started_pids(tmp_path / 'first.pid'), *started_pids(tmp_path / 'last.pid')]
    assert [row['verdict'] for row in read_table(tmp_path / 'grades.csv')] == [
        'not run', 'not ok', 'not run']
    process.end(number)
    eventually(lambda: not [pid for pid in pids if is_running(pid)])
    eventually(lambda: not [*tmp_path.glob('check_arm_*/*')])
    if number == signal.SIGINT:
        assert process.exit_code() == 1
        assert process.output.splitlines() == [
            'fast.py: not ok: It fails: ZeroDivisionError: division by zero (line 1)',
            'check_arm: interrupted: 2 of 3 were not run']
