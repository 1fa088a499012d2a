"""README.md, CONTRIBUTING.md and docs/*.md: links, marks of blocks, the length of the README."""

from collections import Counter
import json
import re

from environment import ROOT
from pages import ANSWERS, BLOCKS, PAGES, SECTIONS
import pytest

import puretf
from puretf import rotations

#: The number of blocks that are not run, by page and mark.
NOT_RUN = {('bags.md', 'dask'): 1, ('desktop.md', 'desktop'): 5, ('desktop.md', 'docker'): 5,
           ('lab.md', 'docker'): 4}


def test_every_block_says_what_it_is():
    """The blocks that are not run are those in `NOT_RUN`; `test/long` runs that of Dask."""
    assert {block.language for block in BLOCKS} == {'python', 'sh', 'text', 'xml'}
    assert Counter((block.page, block.needs) for block in BLOCKS
                   if block.needs and not block.is_file) == NOT_RUN


def test_the_sections_that_have_an_answer_exist():
    """A section of the lab that is renamed must be renamed in `ANSWERS`, too."""
    assert {*SECTIONS} >= {('lab.md', section) for section in ANSWERS}


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
    """The README leads to every page, in at most 110 lines."""
    readme = (ROOT / 'README.md').read_text()
    assert readme.count('\n') <= 110
    assert (ROOT / 'docs' / 'arm.gif').stat().st_size <= 1_000_000
    for page in (ROOT / 'docs').glob('*.md'):
        assert f'(docs/{page.name})' in readme


def test_the_pictures_of_the_code_name_modules_that_exist():
    """So do all names of files in these pages."""
    contributing = (ROOT / 'CONTRIBUTING.md').read_text()
    architecture = (ROOT / 'docs' / 'architecture.md').read_text()
    picture = re.sub(r'\(.*?\)|/tf\w*|viser|rosbags|frames.pdf', '', ' '.join(
        line[10:] for line in contributing.splitlines() if '▶' in line))
    named = {*re.findall(r'[a-z_0-9]+', picture),
             *re.findall(r'(\w+)\.py\b', contributing + architecture)}
    files = [*ROOT.glob('*.py'), *(path.relative_to(ROOT) for package in (
        'puretf', 'puretf_tools', 'dummy_arm', 'test') for path in (ROOT / package).rglob('*.py'))]
    assert named - {'NAME', 'test_NAME'} - {
        name for path in files for name in (path.stem, *path.parts)} == set()
    assert len(named) > 60


def test_names_that_are_missing_are_named():
    """docs/library.md names everything of tf2 and tf_transformations that is missing here."""
    api = json.loads((ROOT / 'test' / 'data' / 'tf2_api.json').read_text())
    text = (ROOT / 'docs' / 'library.md').read_text()
    names = {name for package in ('tf2_ros', 'tf2_py') for name in api[package]}
    assert names.difference(puretf._MODULES) == {
        'BufferClient', 'LookupTransform', 'LookupTransformGoal', 'LookupTransformResult',
        'FrameGraph', 'FrameGraphSrvRequest', 'FrameGraphSrvResponse'}
    quaternion_functions = {name for name in api['tf_transformations'] if 'quaternion' in name}
    missing_functions = {name for name in quaternion_functions if not hasattr(rotations, name)}
    assert missing_functions == {'random_quaternion'}
    for name in 'BufferClient', 'LookupTransform', 'FrameGraph', 'TF2Error', *missing_functions:
        assert f'`{name}`' in text
