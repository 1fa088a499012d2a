"""
The blocks of code in README.md, CONTRIBUTING.md and docs/*.md, and how they are run.

The commands of a section run one after the other, as in several shells: a command that runs until
Ctrl-C is ended at the end of the section. Blocks that need Docker or a ROS desktop are marked
behind the name of their language; a block that is a file is marked with the file's name. Blocks of
`text` are output. The blocks of lab.md run in the directory of a student, which has copies of the
model answers as the student's own programs.
"""

from collections.abc import Callable, Iterator
import os
from pathlib import Path
import re
import shutil
import signal
import sys
from typing import NamedTuple, Optional

from environment import ROOT
from processes import ARM, Process
import pytest

PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').glob('*.md'))]
#: The commands that run until Ctrl-C, and a text that each prints when it works.
ENDLESS = {re.compile(rf'(\.venv/bin/)?{command}\b'): text for command, text in {
    'dummy_arm': 't = 0', 'dynamic_tf_publisher': 'publishing map -> moving_frame',
    'joint_state_publisher': 'look at http://',
    'python docs/examples/record.py': 'recording',
    r'python (dynamic_tf_publisher|dummy_arm)\.py': 'publishing',
    r'python wave\.py': 'waving', 'robot_state_publisher': 'Robot initialized',
    'static_transform_publisher': 'translation: ',
    'tf2_echo (?!.*--(once|bag))': 'At time', 'tf2_monitor': 'RESULTS',
    'view_frames .*--watch': ' Hz ', 'web_view(?!.*--export)': 'look at http://'}.items()}
#: The sections whose commands need the arm, which the text says.
WITH_ARM = {('bags.md', 'Record a bag'), ('commands.md', 'check_arm'), ('commands.md', 'param'),
            ('commands.md', 'tf2_echo'), ('commands.md', 'tf2_monitor'),
            ('commands.md', 'tf_doctor'), ('commands.md', 'tf_trajectory'),
            ('commands.md', 'view_frames'), ('web.md', 'A file that plays without a server')}
#: The sections that take long: they install packages, or start many programs or long ones.
LONG = {('README.md', 'Where it runs'), ('bags.md', 'Install'), ('robots.md', 'Install'), *(
    ('commands.md', name) for name in (
        'check_arm', 'param', 'Several robots', 'tf2_echo', 'tf2_monitor', 'tf_doctor',
        'tf_trajectory', 'view_frames')), *(
    ('lab.md', name) for name in (
        'Step 2: a dynamic transform', 'Step 3: a quaternion', 'Gimbal lock',
        'Step 5: the tree of frames', 'Step 6: the arm', 'For teachers'))}
#: The model answers.
LAB = ROOT / 'lab'
#: The answer that is the student's dynamic_tf_publisher.py, in the sections that change it.
ANSWERS = {'Step 3: a quaternion': 'dynamic_tf_publisher_quaternion.py',
           'Step 4: Euler angles': 'dynamic_tf_publisher_euler.py'}


class Block(NamedTuple):
    """A block of code."""

    page: str
    section: str
    line: int
    language: str
    needs: str  #: the mark behind the language, such as 'docker'; '' if it is run
    code: str

    @property
    def is_file(self) -> bool:
        """Whether the mark is the name of a file, which the commands of all pages can use."""
        return '.' in self.needs


def _blocks() -> Iterator[Block]:
    for page in PAGES:
        section, begin = '', 0
        code: Optional[list[str]] = None
        for number, line in enumerate(page.read_text().splitlines(), 1):
            if line.startswith('```') and code is None:
                begin, code, (language, _, needs) = number, [], line[3:].partition(' ')
            elif line == '```' and code is not None:
                yield Block(page.name, section, begin, language, needs, '\n'.join(code))
                code = None
            elif code is not None:
                code.append(line)
            elif line.startswith('#'):
                section = line.lstrip('# ')
        assert code is None, f'a block of {page.name} has no end'


BLOCKS = list(_blocks())


def commands(page: str, section: str) -> list[str]:
    """Return the commands in the blocks of a section that are run, without comments."""
    code = '\n'.join(block.code for block in BLOCKS if block.language == 'sh' and (
        (block.page, block.section, block.needs) == (page, section, '')))
    lines = code.replace('\\\n', ' ').splitlines()
    return [command for line in lines if (command := re.sub(r'(^|\s+)#.*', '', line))]


#: The sections with commands that are run.
SECTIONS = list(dict.fromkeys(
    (block.page, block.section) for block in BLOCKS if block.language == 'sh' and not block.needs))


@pytest.fixture
def bag_of_a_walk(tmp_path: Path) -> Path:
    """Return a directory dummy_arm with the files of the project, the bags of bags.md and more."""
    bags = pytest.importorskip('bags')
    directory = tmp_path / 'dummy_arm'
    directory.mkdir()
    for path in ROOT.iterdir():
        if path.name[0] != '.' and path.name not in ('build', 'install', 'log'):
            (directory / path.name).symlink_to(path)
    (directory / '.venv').symlink_to(sys.prefix)
    (directory / 'my_robots').mkdir()
    scans = [('/scan', time, bags.point('base_link', time), 'geometry_msgs/msg/PointStamped')
             for time in range(101 * bags.S, 110 * bags.S, bags.S // 4)]
    (file,) = bags.make(
        directory / 'robot_bag', 'mcap', [*bags.walk(), *scans]).glob('*.mcap')
    shutil.copyfile(file, directory / 'robot.mcap')
    cut = bags.checked_mcap(directory / 'cut.mcap', seconds=300)
    cut.write_bytes(cut.read_bytes()[:-1000])
    Path(f'{cut}.zstd').write_bytes(bags.packed(cut.read_bytes(), 'zstd')[:-1000])
    for name in 'split/robot_0.mcap', 'recordings/a.mcap', 'recordings/b.mcap':
        (directory / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(file, directory / name)
    later = bags.make(tmp_path / 'later', 'mcap', [*bags.walk(begin=111 * bags.S)][1:])
    shutil.copyfile(bags.file_of(later), directory / 'split' / 'robot_1.mcap')
    return directory


def _student_directory(home: Path, section: str) -> Path:
    """Return a new directory with the programs that a student has written in a section."""
    directory = home / 'tf_lab'
    directory.mkdir()
    shutil.copyfile(LAB / ANSWERS.get(section, 'dynamic_tf_publisher.py'),
                    directory / 'dynamic_tf_publisher.py')
    shutil.copyfile(LAB / 'dummy_arm.py', directory / 'dummy_arm.py')
    return directory


def run_section(start: Callable[..., Process], directory: Path, page: str, section: str) -> None:
    """
    Run the commands of a section; each ends with exit code 0, by itself or after Ctrl-C.

    :param directory: the directory of the project, `bag_of_a_walk`.
    """
    environment = {'PATH': f'{sys.prefix}/bin{os.pathsep}{os.environ["PATH"]}'}
    if page == 'lab.md':
        environment['HOME'] = str(directory.parent)
        directory = _student_directory(directory.parent, section)
    for block in BLOCKS:
        if block.is_file:
            (directory / block.needs).write_text(block.code)
    if (page, section) in WITH_ARM:
        start(*ARM).line_with('t = 0')
    endless = []
    for command in commands(page, section):
        command = re.sub('^make ', 'make --dry-run ', command)  # other tests, and CI, run these
        texts = [text for pattern, text in ENDLESS.items() if pattern.match(command)]
        process = start('-c', 'import os, sys; os.execvp("bash", ["bash", "-c", sys.argv[1]])',
                        f'exec {command}' if texts else command,
                        cwd=directory, environment=environment)
        if texts:
            process.line_with(*texts)
            endless.append((command, process))
        else:
            assert process.exit_code(300.0) == 0, f'{command}: {process.output}'
    for command, process in endless:
        process.end(signal.SIGINT)
        assert process.exit_code() == 0, f'{command}: {process.output}'
        assert 'Traceback' not in process.output, f'{command}: {process.output}'
