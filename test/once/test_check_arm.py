"""check_arm runs programs, judges their arms, and leaves none running."""

import csv
import os
import re
import signal
import time

from environment import ROOT
from processes import is_running, TIMEOUT, tool

MODEL = ROOT / 'lab' / 'dummy_arm.py'


def program(*changes):
    """Return the model answer with small changes."""
    code = MODEL.read_text()
    for old, new in changes:
        assert code.count(old) == 1, old
        code = code.replace(old, new)
    return code


#: By file: the program, and the line that is printed, with # for each measured number, since these
#: depend on the load of the machine. test_the_measured_values checks the numbers.
PROGRAMS = {
    'model.py': (program(), 'ok'),
    'only_main.py': (program(("\n\nif __name__ == '__main__':\n    main()\n", '\n'),
                             ('create_timer(0.02', 'create_timer(0.2'),
                             ('\n\nclass', '\nimport sys\nname = __name__\nif sys.path:\n'
                                           '    sys.path.append("")\n\nclass')),
                     'ok; advice: at least 10 messages per second (# Hz)'),
    'full_angle.py': (program(('sin(angle / 2)', 'sin(angle)'), ('cos(angle / 2)', 'cos(angle)')),
                      'not ok: joint_1 stays within ±45° (#° to #°). The limit is exceeded by #°: '
                      'the angle is twice as large as it should be. In the quaternion, use the '
                      'half angle: z = sin(angle / 2), w = cos(angle / 2). (2 more)'),
    'base_on_tf.py': (program(('self.static_broadcaster.sendTransform(self.transform(',
                               'self.create_timer(0.1, lambda: self.broadcaster.sendTransform('
                               'self.transform('),
                              ("'base_link', (0.0, 0.0, 0.0), 0.0))",
                               "'base_link', (0.0, 0.0, 0.0), 0.0)))")),
                      'not ok: base_link is on /tf_static (/tf). map → base_link is sent on /tf: '
                      'use StaticTransformBroadcaster, which sends on /tf_static.'),
    'dropped.py': (program(('        self.start = ', '        self.later = self.create_timer(\n'
                            '            15.0, lambda: self.destroy_publisher(\n'
                            '                self.static_broadcaster.pub_tf))\n'
                            '        self.start = ')),
                   'not ok: base_link reaches a late listener (not received). A listener that '),
    'stamp_once.py': (program(('self.transform(now, parent', 'self.transform(self.start, parent')),
                      'not ok: the stamps are the current time (joint_1: always the same). '),
    'star.py': (program(("('joint_1', 'joint_2'", "('base_link', 'joint_2'"),
                        ("('joint_2', 'joint_3'", "('base_link', 'joint_3'")),
                'not ok: the tree (base_link → joint_2). The tree is a star: joint_1, joint_2, '
                'joint_3 have the same parent.'),
    'another_type.py': (program(
        ('self.broadcaster = TransformBroadcaster(self)',
         'self.broadcaster = self.create_publisher(TransformStamped, "tf", 10)'),
        ('self.broadcaster.sendTransform([', '[*map(self.broadcaster.publish, ['),
        ('limit in JOINTS])', 'limit in JOINTS])]')),
        'not ok: /dummy_arm publishes geometry_msgs/msg/TransformStamped on /tf. The type must be '
        'tf2_msgs/msg/TFMessage: send transforms with a TransformBroadcaster or '),
    'syntax.py': ('import rclpy\nprint("no end)\n',
                  'not ok: It does not compile: line 2: unterminated string literal'),
    'crash.py': ('import rclpy\nrclpy.init()\nnode = rclpy.create_node("a")\n\n\ndef f():\n'
                 '    node.no_method()\n\n\nf()\n',
                 "not ok: It fails: AttributeError: 'Node' object has no attribute 'no_method' "
                 '(line 7)'),
    'fails_often.py': (program(('        now = self', '        import traceback\n        try:\n'
                              '            1 / 0\n        except ZeroDivisionError:\n'
                              '            traceback.print_exc()\n        now = self')),
                     'not ok: It fails: ZeroDivisionError: division by zero (line '),
    'slow_traceback.py': ('import time\nprint("Traceback (most recent call last):", flush=True)\n'
                          'time.sleep(2)\nprint("  File a, line 1\\nValueError: x", flush=True)\n'
                          'time.sleep(100)\n', 'not ok: It fails: ValueError: x'),
    'deep.py': ('-' * 100_000 + '1\n', 'not ok: It does not compile: '),
    'ends.py': ('print("done")\n', 'not ok: It ended by itself after '),
    'loud.py': ('while True:\n    print("x" * 10_000)\n', 'not ok: It prints more than 1 MB.'),
    'silent.py': ('import signal, subprocess, sys, time\nsignal.signal(2, signal.SIG_IGN)\n'
                  'subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1000)"],\n'
                  '                 start_new_session=True)\ntime.sleep(1000)\n',
                  'not ok: It publishes nothing on /tf and /tf_static within 20 s: is the timer '
                  'created, and does rclpy.spin run?'),
    'missing.py': (None, 'not ok: It cannot be read: No such file or directory.'),
    'binary.py': ('\0', 'not ok: It does not compile: '),
}


def test_programs(start, tmp_path):
    """Each program gets its line, in the order of the arguments, and a row of the table."""
    for name, (code, _) in PROGRAMS.items():
        if code is not None:
            (tmp_path / name).write_text(code)
    process = start(*tool('check_arm', *PROGRAMS, '--csv', 'grades.csv', '--jobs', '8'),
                    cwd=tmp_path)
    assert process.exit_code(240.0) == 1
    lines = process.output.splitlines()
    assert len(lines) == len(PROGRAMS), process.output
    for line, (name, (_, expected)) in zip(lines, PROGRAMS.items()):
        assert re.sub(r'-?\d+\.\d+', '#', line).startswith(f'{name}: {expected}'), line
    assert not process.has_left_processes()
    with (tmp_path / 'grades.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert [row['file'] for row in rows] == [*PROGRAMS]
    assert [row['verdict'] == 'ok' for row in rows] == [
        expected.startswith('ok') for _, expected in PROGRAMS.values()]
    assert [*rows[0].values()] == ['model.py', 'ok', '', *['ok'] * 31]
    (full_angle,) = (row for row in rows if row['file'] == 'full_angle.py')
    assert full_angle['at least 10 messages per second'] == 'ok'
    assert full_angle['joint_1 stays within ±45°'] == 'not ok'
    assert full_angle['joint_1 moves as a sine'] == 'ok'
    assert f"full_angle.py: not ok: {full_angle['reason']}" in lines
    assert {path.name for path in tmp_path.iterdir()} == {
        'grades.csv', *(name for name, (code, _) in PROGRAMS.items() if code is not None)}


ENDLESS = """import os, signal, subprocess, sys, time
from pathlib import Path
signal.signal(2, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(1000)'],
                         start_new_session=True)
Path(sys.argv[0]).with_suffix('.pid').write_text(f'{os.getpid()} {child.pid} end')
time.sleep(1000)
"""


def started_pids(path):
    """Wait until a program has written its process ids, and return them."""
    deadline = time.monotonic() + TIMEOUT
    while not path.exists() or not path.read_text().endswith('end'):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return [int(word) for word in path.read_text().split()[:-1]]


def test_ctrl_c_ends_the_programs(start, tmp_path):
    """What was judged is printed and in the table, and no program is left, nor its children."""
    for name, code in ('first.py', ENDLESS), ('fast.py', ''), ('last.py', ENDLESS):
        (tmp_path / name).write_text(code)
    process = start(*tool('check_arm', 'first.py', 'fast.py', 'last.py', '--csv', 'grades.csv',
                          '--jobs', '2'), cwd=tmp_path)
    pids = [*started_pids(tmp_path / 'first.pid'), *started_pids(tmp_path / 'last.pid')]
    process.end(signal.SIGINT)
    assert process.exit_code() == 1
    lines = process.output.splitlines()
    assert lines[0].startswith('fast.py: not ok: It ended by itself')
    assert lines[1:] == ['check_arm: interrupted: the files without a line were not judged']
    assert not [pid for pid in pids if is_running(pid)]
    with (tmp_path / 'grades.csv').open(newline='') as file:
        assert [row['file'] for row in csv.DictReader(file)] == ['fast.py']


def test_a_killed_check_arm_leaves_no_program(start, tmp_path):
    """The kernel ends the program if check_arm is killed, or its terminal is closed."""
    (tmp_path / 'endless.py').write_text(ENDLESS)
    process = start(*tool('check_arm', 'endless.py'), cwd=tmp_path)
    pid, child = started_pids(tmp_path / 'endless.pid')
    process.end(signal.SIGKILL)
    deadline = time.monotonic() + TIMEOUT
    while is_running(pid):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
