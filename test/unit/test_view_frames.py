"""The logic of `view_frames`: the tree as text, files that are written, trees of bags."""

from pathlib import Path
import re
import sys

import pytest

from puretf import Frame
from puretf_tools.commands import view_frames
from puretf_tools.commands.view_frames import main
from puretf_tools.inspection.forest import Forest

S = 10**9


def static(name, parent, publisher='/node'):
    """Return a static frame."""
    return Frame(name, parent, publisher, True, 1, 0, 0)


def dynamic(name, parent, hertz=10):
    """Return a dynamic frame, sent from 95 s to 100 s."""
    return Frame(name, parent, '/node', False, hertz * 5 + 1, 100 * S, 95 * S)


@pytest.fixture
def make_bag(bags, tmp_path):
    """Bags, by `make_bag(kind, messages)`."""
    return lambda kind, messages: str(bags.make(tmp_path / f'robot.{kind}', kind, messages))


@pytest.fixture
def walk(bags, make_bag):
    """A bag of a robot that moves."""
    return make_bag('mcap', bags.walk())


def test_the_trees_in_the_terminal():
    """Rates, ages and publishers are in columns."""
    frames = [static('base', 'map'), dynamic('arm', 'base', 50), dynamic('日本', 'arm', 1),
              dynamic('wheel', 'base'), static('a', 'b'), static('b', 'a'), static('tab\t', 'b')]
    assert view_frames.format_tree(Forest(frames), 100 * S + S // 4) == [
        'map',
        '└── base           static                 /node',
        '    ├── arm       50.0 Hz    0.250 s old  /node',
        '    │   └── 日本     1.0 Hz    0.250 s old  /node',
        '    └── wheel     10.0 Hz    0.250 s old  /node',
        'b',
        '├── a              static                 /node',
        '│   └── b          static                 /node',
        '└── tab\\t          static                 /node',
    ]


@pytest.mark.parametrize(('now', 'age'), [
    (0, '? s old'), (99 * S, '1.000 s ahead'), (100 * S, '0.000 s old'), (101 * S, '1.000 s old')])
def test_an_age_is_not_negative(now, age):
    """0: the clock of the node waits for /clock."""
    (_, line) = view_frames.format_tree(Forest([dynamic('arm', 'base')]), now)
    assert line.split(maxsplit=4)[-1].startswith(age)


@pytest.mark.parametrize(('output', 'files', 'begin'), [
    ('tree', {'tree.pdf', 'tree.gv'}, b'%PDF'), ('tree.svg', {'tree.svg', 'tree.gv'}, b'<?xml'),
    ('my.robot.PNG', {'my.robot.PNG', 'my.robot.gv'}, b'\x89PNG')])
def test_the_ending_says_how_to_draw(there, output, files, begin):
    """The suffix of the output file is the format; the .gv file is written beside it."""
    pytest.importorskip('pygraphviz')
    path = view_frames.output_path(output)
    view_frames.save(Forest([static('base', 'map')]), 0, path)
    assert {path.name for path in there.iterdir()} == files
    (drawn,) = (name for name in files if not name.endswith('.gv'))
    assert str(path) == drawn
    assert path.read_bytes().startswith(begin)


def test_without_pygraphviz(failed, monkeypatch, there, walk):
    """The .gv file is written; tf2 exits with code 0."""
    monkeypatch.setitem(sys.modules, 'pygraphviz', None)
    code, line = failed(main, '--bag', walk)
    assert code == 1
    assert re.fullmatch(r'view_frames: drawing needs pygraphviz, which cannot be imported \(.*\): '
                        'pip install pygraphviz; or with ROS .*; wrote frames.gv\n', line)
    assert [path.name for path in there.iterdir()] == ['frames.gv']
    assert '"map" -> "odom"' in Path('frames.gv').read_text()


def test_more_frames_than_can_be_drawn(bags, capsys, failed, make_bag, there):
    """The error has the remedy; the .gv file can be drawn elsewhere, and a part here."""
    bag = make_bag('mcap', [('/tf_static', 0, [
        bags.row(0, f'f{i}', f'f{i + 1}') for i in range(2000)])])
    code, line = failed(main, '--bag', bag)
    assert (code, line) == (1, 'view_frames: 2001 frames are too many to draw; the limit is 2000: '
                               'draw a part with --root FRAME, or print the tree with --text; '
                               'wrote frames.gv\n')
    assert [path.name for path in there.iterdir()] == ['frames.gv']
    assert Path('frames.gv').read_text().count('->') == 2000
    pytest.importorskip('pygraphviz')
    assert main(['--bag', bag, '--root', 'f1990']) == 0
    assert Path('frames.pdf').read_bytes().startswith(b'%PDF')


@pytest.mark.parametrize(('kind', 'publisher'), [('mcap', 'not recorded'), ('bag', '/sender')])
def test_a_bag_is_drawn(bags, capsys, make_bag, there, kind, publisher):
    """The PDF shows the frames as they were at the end of the bag."""
    pytest.importorskip('pygraphviz')
    pypdf = pytest.importorskip('pypdf')
    assert main(['--bag', make_bag(kind, bags.walk())]) == 0
    assert capsys.readouterr() == (
        'wrote frames.pdf and frames.gv: frames: 3, transforms: 2, root: map\n'
        'ages are relative to the end of the bag, 110.000000000 s\n', '')
    text = pypdf.PdfReader('frames.pdf').pages[0].extract_text()
    for words in ('map', 'odom', 'base_link', f'Broadcaster: {publisher}',
                  'Recorded at time: 110.000000', 'Most recent transform: 110.000000000'):
        assert words in text


@pytest.fixture
def house(bags, make_bag):
    """A bag with a tree, a loop, and branches that end at different times."""
    return make_bag('mcap', [
        *bags.walk(seconds=10), *(('/tf', time, [bags.row(time, *edge)]) for time, edge in (
            (102 * S, ('base_link', 'arm')), (104 * S, ('base_link', 'arm')),
            (104 * S, ('arm', 'tool')), (104 * S, ('x', 'y')), (104 * S, ('y', 'z')),
            (104 * S, ('z', 'x')), (104 * S, ('y', 'twig'))))])


def test_loops_are_reported(capsys, house, there):
    """A loop is drawn, too; tf2 ends with exit code 0 and without a PDF."""
    pytest.importorskip('pygraphviz')
    assert main(['--bag', house]) == 0
    out, err = capsys.readouterr()
    assert re.fullmatch('view_frames: warning: these frames form a loop: '
                        '(x -> y -> z -> x|y -> z -> x -> y|z -> x -> y -> z)\n', err)
    assert 'frames: 9, transforms: 8, root: map\n' in out
    assert (there / 'frames.pdf').exists()


@pytest.mark.parametrize(('root', 'tree'), [
    ('/base_link', ['base_link', '└── arm', '    └── tool']),
    ('odom', ['odom', '└── base_link', '    └── arm', '        └── tool']), ('tool', ['tool'])])
def test_the_tree_below_a_root(capsys, house, root, tree):
    """There is no warning of a loop elsewhere; ages are relative to the end of the whole bag."""
    assert main(['--text', '--bag', house, '--root', root]) == 0
    out, err = capsys.readouterr()
    *lines, last = out.splitlines()
    assert [re.sub(' +[0-9?.]+ Hz.*', '', line) for line in lines] == tree
    assert ('6.000 s old' in out) == (root != 'tool')
    assert last == 'ages are relative to the end of the bag, 110.000000000 s'
    assert err == ''


def test_a_root_that_does_not_exist(failed, house):
    """The error is one line with the nearest names."""
    assert failed(main, '--text', '--bag', house, '--root', 'base_lnk') == (
        1, "view_frames: frame 'base_lnk' does not exist. Nearest known: 'base_link'.\n")
