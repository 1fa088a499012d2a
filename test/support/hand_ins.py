"""
Programs that are handed in to check_arm, and what it must say about each.

CHAOS are programs that hang, leave processes, exhaust the machine or send signals, as programs do
that are merely wrong. All of their processes end by themselves within 90 s, and they send signals
only to check_arm and to what it has started. MISTAKES are those of students; some are right.
"""

import csv
import re
from textwrap import dedent
from typing import NamedTuple

from environment import ROOT

MODEL = ROOT / 'lab' / 'dummy_arm.py'


class HandIn(NamedTuple):
    """A program that was handed in, and its grade."""

    source: str | None  #: the content of its file; None: there is no file
    verdict: str  #: a regular expression, too
    reason: str  #: a regular expression for the cause, or for the advice if it is ok

    def write(self, path):
        """Write the file, if there is one."""
        if self.source is not None:
            path.write_text(self.source)


def program(*changes):
    """Return the model answer with small changes."""
    code = MODEL.read_text()
    for old, new in changes:
        assert code.count(old) == 1, old
        code = code.replace(old, new)
    return code


def limited(code):
    """Return a program with a limited time; the functions are those that the programs need."""
    return dedent("""
        import os, signal, subprocess, sys, time

        signal.alarm(90)


        def pkill(name):
            # As `pkill -f name`, but only check_arm and what it has started; the sender ends.
            import psutil
            if os.fork():
                os.wait()
                return
            top = [each for each in psutil.Process().parents()
                   if '.check_arm()' in str(each.cmdline())]
            for each in [top[-1], *top[-1].children(recursive=True)]:
                try:
                    if each.pid != os.getpid() and name in str(each.cmdline()):
                        each.terminate()
                except psutil.Error:  # it has ended
                    pass
            os._exit(0)

        """) + dedent(code)


SIM_TIME = ("super().__init__('dummy_arm')", """super().__init__('dummy_arm', parameter_overrides=[
            rclpy.Parameter('use_sim_time', value=True)])""")
MODEL_ANSWER = HandIn(program(), 'ok', '')

#: Programs that run the arm of this package.
_STARTS = ('from dummy_arm.entry_points import dummy_arm; dummy_arm()',
           'import dummy_arm.dummy_arm as it; it.main()',
           'from os import execv; from sys import executable as it; '
           'execv(it, [it, "-c", "import dummy_arm.arm"])')
_IS_OURS = r'^The arm must be its own: it imports or starts dummy_arm\.(dummy_)?arm of this p'

#: By file.
MISTAKES = {
    # Right programs
    'only_main.py': HandIn(program(
        ("\n\nif __name__ == '__main__':\n    main()\n", '\n'),
        ('create_timer(0.02', 'create_timer(0.2')), 'ok', 'at least 10 messages per second'),
    'half_step.py': HandIn(program(
        ('self.start = self.get_clock().now()', 'self.t = 0.0'),
        ('t = (now - self.start).nanoseconds * 1e-9', 't = self.t = self.t + 0.01')),
        'not judged', r'half as fast as the sheet .* the step is fixed, .* \(--time 45\)'),
    'prints.py': HandIn(program(
        ('        now = self', '        print(9000 * "x")\n        now = self')), 'ok', ''),
    'turns.py': HandIn(program(('sin(speed * t)', 'sin(6.28 * speed * t)')), 'ok',
                       r'^advice: speeds .*1\.88 in place of 0\.3 rad.*is there a factor 2π'),
    'int.py': HandIn(program(('translation.y = y', 'translation.y = 0')),
                     'ok', r'all numbers are floats \(an int in line 42\)'),
    'called.py': HandIn(program(('self.create_timer(0.02, self.send)',
                                 'self.create_timer(0.02, self.send())')),
                        'not ok', r'not callable \(line 61\): .* write self\.tick'),

    # Wrong arms
    'full_angle.py': HandIn(program(
        ('sin(angle / 2)', 'sin(angle)'), ('cos(angle / 2)', 'cos(angle)')),
        'not ok', r'twice as large .* half angle'),
    'dropped.py': HandIn(program(
        ('        self.start = ',
         '        self.later = self.create_timer(15.0, lambda: self.destroy_publisher(\n'
         '            self.static_broadcaster.pub_tf))\n'
         '        self.start = ')),
        'not ok', r'late listener \(not received\)'),
    # Most of the messages arrive, so the arm is right.
    'many_broadcasters.py': HandIn(program(
        ('        self.broadcaster = TransformBroadcaster(self)\n', ''),
        ('self.broadcaster.sendTransform([', 'TransformBroadcaster(self).sendTransform([')),
        'ok', r'created once \(\d{3,} publishers\)'),
    'another_type.py': HandIn(program(
        ('self.broadcaster = TransformBroadcaster(self)',
         'self.broadcaster = self.create_publisher(TransformStamped, "tf", 10)'),
        ('self.broadcaster.sendTransform([', '[*map(self.broadcaster.publish, ['),
        ('limit in JOINTS])', 'limit in JOINTS])]')),
        'not ok', 'publishes geometry_msgs/msg/TransformStamped on /tf'),

    # Nothing on /tf
    'slow_timer.py': HandIn(program(('create_timer(0.02', 'create_timer(20.0')),
                            'not ok', 'period.* second|second.* period'),
    'no_spin.py': HandIn(program(('rclpy.spin(DummyArm())', 'DummyArm()')),
                         'not ok', r'does it call rclpy\.spin\?'),
    'not_called.py': HandIn(program(('\n    main()\n', '\n    main\n')), 'not ok',
                            r'exit code 0: line 67 only names main: a call is main\(\)$'),
    # The time stays 0. Timers never fire, but a thread sends transforms.
    'no_clock.py': HandIn(program(SIM_TIME), 'not ok',
                          r'nothing arrives on /tf\. use_sim_time needs /clock, .* leave it out'),
    'no_clock_thread.py': HandIn(program(
        SIM_TIME, ('        rclpy.spin(DummyArm())', """        import threading, time
        arm = DummyArm()
        threading.Thread(target=rclpy.spin, args=(arm,), daemon=True).start()
        while True:
            arm.send()
            time.sleep(0.02)""")), 'not ok', 'joint_1 is 0: use_sim_time needs /clock, which'),
    # Tests use the domains up to 100. The ports of 101 are still below those for clients.
    'domain_in_init.py': HandIn(program(('rclpy.init()', 'rclpy.init(domain_id=101)')),
                                'not ok', r'domain\D*\b101\b'),

    'lifecycle.py': HandIn(limited("""
        import rclpy
        from rclpy.lifecycle import Node

        rclpy.init()
        rclpy.spin(Node('arm'))
        """), 'not ok', '/arm is a lifecycle node: is it configured and activated'),

    # No program, or an error
    'missing.py': HandIn(None, 'not ok', 'No such file|It is empty'),
    'crash.py': HandIn(program(
        ('        now = self', '        self.no_method()\n        now = self')), 'not ok',
        r"AttributeError: 'DummyArm' object has no attribute 'no_method' \(line 50\)")}

NEW = '\n'
SLEEPS = limited("""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    time.sleep(90)
    """)

#: By file.
CHAOS = {
    # Signals; the arm is right
    'pkill_python.py': HandIn(limited("""
        pkill('python')
        """) + program(), 'ok', ''),
    'kills_parent.py': HandIn(limited("""
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(90)
        """), 'not judged', 'The process that runs and observes it ended by signal 9'),

    # Programs that end or hang
    'sys_exit.py': HandIn(program(('rclpy.spin(DummyArm())', 'DummyArm()\n        sys.exit(3)'),
                                  ('from math', 'import sys\nfrom math')),
                          'not ok', 'ended by itself .* with exit code 3'),
    'input.py': HandIn(limited("""
        name = input('Your name? ')
        """) + program(), 'not ok', r'\(line \d+\): nobody types what input\(\) reads'),
    'sleeps.py': HandIn(SLEEPS, 'not ok',
                        rf'Nothing was received .* in line {SLEEPS.count(NEW)}: is there a loop'),
    'loops.py': HandIn(limited('') + program((
        '        now = self.get_clock().now()\n', '        while True:\n            pass\n')),
        'not ok', r'nothing arrives on /tf\. The program is in line \d+: is there a loop'),
    'loops_in_a_function.py': HandIn(limited('') + program(
        ('    def send', '    def turn(self):\n        [*map(cos, range(10**6))]\n\n    def send'),
        ('        now =', '        while True:\n            self.turn()\n        now =')),
        'not ok', r'in line \d+ \(called from line \d+\): is there a loop'),

    # Survivors
    'survivors.py': HandIn(limited("""
        if os.fork() == 0:  # a daemon, which a subreaper adopts
            os.setsid()
            if os.fork():
                os._exit(0)
            os.closerange(0, 1024)
            os.execve('/bin/sleep', ['sleep', '90'], {})
        subprocess.Popen(['sleep', '90'], start_new_session=True)
        """) + program(), 'ok', ''),
    'ends_its_children.py': HandIn(limited("""
        import multiprocessing
        child = subprocess.Popen(['sleep', '90'])
        child.terminate()
        child.wait()
        child = multiprocessing.Process(target=time.sleep, args=(90,))
        child.start()
        child.terminate()
        child.join()
        """) + program(), 'ok', ''),

    # Programs that take too much
    # Small processes, in sessions of their own: 128 have less memory than its limit.
    'fork_bomb.py': HandIn(limited("""
        for _ in range(11):
            if os.fork() == 0:
                os.setsid()
            signal.alarm(60)
        time.sleep(60)
        """), 'not ok', 'more than 128 processes'),
    # 2.8 GiB, but only 0.6 GiB in each process.
    'memory_hog.py': HandIn(limited("""
        for _ in range(5):
            if os.fork() == 0:
                signal.alarm(60)
                held = b'x' * (9 * 2**26)
                break
        time.sleep(60)
        """), 'not ok', r'(?i)\bGiB\b|memory'),
    'one_large_array.py': HandIn('held = bytearray(2**40)\n', 'not ok', r'MemoryError \(line 1\)'),
    'large_file.py': HandIn(limited("""
        with open('large', 'wb') as file:
            for _ in range(201):
                file.write(bytes(10**6))
        """), 'not ok', 'File too large'),
    'endless_line.py': HandIn(limited("""
        while True:
            sys.stdout.write('x' * 2**16)
        """), 'not ok', r'It prints more than 100 MB: leave out print\(\), or end its loop\.$'),
    'floods.py': HandIn(limited('') + program(
        ('        self.broadcaster.sendTransform([',
         '        while True:\n            self.broadcaster.sendTransform(1000 * ['),
        ('            self.transform(now, parent', '                self.transform(now, parent')),
        'not ok|not judged',  # a busy computer is too slow to receive them in time
        'More transforms arrive|more than once|has not been sent|Nothing was|said nothing'),
    # What it changes is a copy
    'deletes_its_folder.py': HandIn(limited("""
        import shutil
        shutil.rmtree(os.path.dirname(__file__))
        """) + program(), 'ok', ''),

    # The row would be a formula in a spreadsheet, and its line would be overwritten in a terminal.
    '=1+1.py': HandIn(r"raise ValueError('\x1b[2K\x1b[1A\rother: ok')", 'not ok',
                      r'ValueError: \\x1b\[2K\\x1b\[1A'),

    # The arm of this package
    'imports_package.py': HandIn('import sys\ndel sys.path[:2]\nfrom dummy_arm.dummy_arm import '
                                 'main\nmain()\n', 'not ok', _IS_OURS),
    **{f'starts_package_{i}.py': HandIn(
        limited(f'subprocess.run([sys.executable, "-c", {code!r}], cwd="/")'), 'not ok', _IS_OURS)
        for i, code in enumerate(_STARTS)}}


def read_table(path):
    """Return the rows of a table of check_arm."""
    with path.open(newline='', encoding='utf-8-sig') as file:
        return [*csv.DictReader(file)]


def differences(expected, output, table):
    """
    Compare what check_arm says with what is expected.

    :param expected: the hand-ins, by the names of the files or folders that check_arm was given.
    :param output: what check_arm has printed.
    :param table: the path of its table.
    :returns: by name: a text that says what is different; '' as a name stands for the whole.
    """
    rows = read_table(table)
    # Signals whose sender has ended cause warnings.
    lines = [line for line in output.splitlines() if not line.startswith('check_arm: warning: ')]
    found = {}
    if not len(lines) == len(rows) == len(expected):
        found[''] = f'{len(lines)} lines and {len(rows)} rows for {len(expected)} files:\n{output}'
    for (name, hand_in), row in zip(expected.items(), rows):
        (line,) = [line for line in lines if line.startswith(f'{name}: {row["verdict"]}')]
        if not (row['file'].removeprefix("'") == name
                and re.fullmatch(hand_in.verdict, row['verdict'])
                and re.search(hand_in.reason, row['reason'])
                and row['reason'] in line):
            found[name] = f'{hand_in.verdict} ({hand_in.reason!r}) expected, got {line}'
        elif not line.isprintable():
            found[name] = f'not printable: {line!r}'
    return found
