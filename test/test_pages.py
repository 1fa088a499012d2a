"""
README.md and docs/*.md: every block of code in them runs, and every link leads somewhere.

The commands of a section run one after the other, as in several shells: a command that runs until
Ctrl-C is ended at the end of the section. Blocks that need Docker or a ROS desktop are marked
behind the name of their language and listed in `NOT_RUN`. Blocks of `text` are output.
"""

from collections import Counter
from collections.abc import Iterator
import json
import os
from pathlib import Path
import re
import shutil
import signal
import sys
from typing import NamedTuple, Optional

from conftest import ARM
import pytest

from dummy_arm import tf
from dummy_arm.tf import rotations

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').glob('*.md'))]
#: The number of blocks that are not run, by page and mark.
NOT_RUN = {('desktop.md', 'desktop'): 5, ('desktop.md', 'docker'): 5, ('lab.md', 'docker'): 3}
#: The commands that run until Ctrl-C, and a text that each prints when it works.
ENDLESS = {re.compile(rf'(\.venv/bin/)?{command}\b'): text for command, text in {
    'dummy_arm': 't = 0', 'dynamic_tf_publisher': 'publishing map -> moving_frame',
    'python docs/examples/record.py': 'recording', 'python lab/': 'publishing',
    'static_transform_publisher': 'translation: ',
    'tf2_echo (?!.*--(once|bag))': 'At time', 'tf2_monitor': 'RESULTS',
    'view_frames .*--watch': ' Hz ', 'web_view': 'look at http://'}.items()}
#: The sections whose commands need the arm, which the text says.
WITH_ARM = {('bags.md', 'Record a bag'), ('commands.md', 'check_arm'), ('commands.md', 'param'),
            ('commands.md', 'tf2_echo'), ('commands.md', 'tf2_monitor'),
            ('commands.md', 'tf_doctor'), ('commands.md', 'tf_trajectory'),
            ('commands.md', 'view_frames')}
#: The sections that take long: they install packages, or start many programs or long ones.
LONG = {('README.md', 'A first program'), ('bags.md', 'Install'), *(
    ('commands.md', name) for name in (
        'check_arm', 'param', 'Several robots', 'tf2_echo', 'tf2_monitor', 'tf_doctor',
        'tf_trajectory', 'view_frames')), *(
    ('lab.md', name) for name in (
        'Step 2: a dynamic transform', 'Step 3: a quaternion', 'Gimbal lock',
        'Step 5: the tree of frames', 'Step 6: the arm', 'For teachers'))}


class Block(NamedTuple):
    """A block of code."""

    page: str
    section: str
    line: int
    language: str
    needs: str  #: the mark behind the language: 'desktop' or 'docker'; '' if it is run
    code: str


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


def commands(page, section):
    """Return the commands in the blocks of a section that are run, without comments."""
    code = '\n'.join(block.code for block in BLOCKS if block.language == 'sh' and (
        (block.page, block.section, block.needs) == (page, section, '')))
    lines = code.replace('\\\n', ' ').splitlines()
    return [command for line in lines if (command := re.sub(r'(^|\s+)#.*', '', line))]


def test_every_block_says_what_it_is():
    """The blocks that are not run are those in `NOT_RUN`."""
    assert {block.language for block in BLOCKS} == {'python', 'sh', 'text'}
    assert Counter((block.page, block.needs) for block in BLOCKS if block.needs) == NOT_RUN
    assert all(block.language == 'sh' for block in BLOCKS if block.needs)


@pytest.mark.parametrize('block', [
    pytest.param(block, id=f'{block.page}:{block.line}')
    for block in BLOCKS if block.language == 'python'])
def test_python_runs(start, bag_of_a_walk, block, request):
    """Each block is a complete program. Some of them need the arm, and one runs until Ctrl-C."""
    for name in re.findall(r'^(?:import|from) (tf\w+)', block.code, re.MULTILINE):
        pytest.importorskip(name)
    begin = 'recorded at most 0.001 s' if 'recorded at most' in block.code else ''
    if 'end_effector' in block.code:
        start(*ARM).line_with('t = 0')
        begin = 'geometry_msgs.msg.Vector3('
    process = start('-c', block.code, cwd=bag_of_a_walk)
    if 'rclpy.spin(' in block.code:
        ros = request.getfixturevalue('ros')
        ros.until(lambda: ros.node.count_publishers('/tf'))
        process.press_ctrl_c()
    assert process.exit_code() == 0, process.output
    assert process.output.startswith(begin)
    assert process.output.count('\n') == bool(begin)


@pytest.fixture
def bag_of_a_walk(tmp_path):
    """Return a directory with the files of the project, robot_bag and robot.mcap."""
    bags = pytest.importorskip('bags')
    for path in ROOT.iterdir():
        if path.name[0] != '.' and path.name not in ('build', 'install', 'log'):
            (tmp_path / path.name).symlink_to(path)
    (tmp_path / '.venv').symlink_to(sys.prefix)
    (file,) = bags.make(tmp_path / 'robot_bag', 'mcap', bags.walk()).glob('*.mcap')
    shutil.copyfile(file, tmp_path / 'robot.mcap')
    return tmp_path


SECTIONS = list(dict.fromkeys(
    (block.page, block.section) for block in BLOCKS if block.language == 'sh' and not block.needs))


@pytest.mark.parametrize(('page', 'section'), [
    pytest.param(*section, marks=pytest.mark.soak if section in LONG else ())
    for section in SECTIONS])
def test_commands_run(start, bag_of_a_walk, page, section):
    """Each command ends with exit code 0, by itself or after Ctrl-C."""
    if (page, section) in WITH_ARM:
        start(*ARM).line_with('t = 0')
    endless = []
    for command in commands(page, section):
        command = re.sub('^make ', 'make --dry-run ', command)  # other tests, and CI, run these
        texts = [text for pattern, text in ENDLESS.items() if pattern.match(command)]
        process = start('-c', 'import os, sys; os.execvp("bash", ["bash", "-c", sys.argv[1]])',
                        f'exec {command}' if texts else command,
                        cwd=bag_of_a_walk, environment={
                            'PATH': f'{sys.prefix}/bin{os.pathsep}{os.environ["PATH"]}'})
        if texts:
            process.line_with(*texts)
            endless.append((command, process))
        else:
            assert process.exit_code(300.0) == 0, f'{command}: {process.output}'
    for command, process in endless:
        process.end(signal.SIGINT)
        assert process.exit_code() == 0, f'{command}: {process.output}'
        assert 'Traceback' not in process.output, f'{command}: {process.output}'


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page):
    """A relative link leads to a file, and to a heading of it if it has an anchor."""
    anchors = {path: {re.sub(r'[^\w-]', '', heading.lower().replace(' ', '-')) for heading in
                      re.findall(r'^#+ (.*)$', path.read_text(), re.M)} for path in PAGES}
    links = re.findall(r'\]\((?!http)([^)]+)\)', page.read_text())
    for link in links:
        name, _, anchor = link.partition('#')
        target = page.parent / name if name else page
        assert target.exists(), link
        assert not anchor or anchor in anchors[target.resolve()], link


def test_the_readme_is_short_and_its_picture_small():
    """The README leads to every page, in at most 130 lines."""
    readme = (ROOT / 'README.md').read_text()
    assert readme.count('\n') <= 130
    assert (ROOT / 'docs' / 'arm.gif').stat().st_size <= 1_000_000
    for page in (ROOT / 'docs').glob('*.md'):
        assert f'(docs/{page.name})' in readme


def test_names_that_are_missing_are_named():
    """docs/library.md names everything of tf2 and tf_transformations that is missing here."""
    api = json.loads((ROOT / 'test' / 'data' / 'tf2_api.json').read_text())
    text = (ROOT / 'docs' / 'library.md').read_text()
    names = {name for package in ('tf2_ros', 'tf2_py') for name in api[package]}
    assert names.difference(tf.__all__) == {
        'BufferClient', 'LookupTransform', 'LookupTransformGoal', 'LookupTransformResult',
        'FrameGraph', 'FrameGraphSrvRequest', 'FrameGraphSrvResponse'}
    quaternion_functions = {name for name in api['tf_transformations'] if 'quaternion' in name}
    missing_functions = {name for name in quaternion_functions if not hasattr(rotations, name)}
    assert missing_functions == {'random_quaternion'}
    for name in 'BufferClient', 'LookupTransform', 'FrameGraph', 'TF2Error', *missing_functions:
        assert f'`{name}`' in text
