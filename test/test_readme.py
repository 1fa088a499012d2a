"""The README's programs, and the examples."""

from pathlib import Path
import re
import signal

from conftest import ARM
import pytest

ROOT = Path(__file__).parent.parent
BLOCKS = re.findall(r'^```python\n(.*?)^```$', (ROOT / 'README.md').read_text(), re.M | re.S)


@pytest.mark.parametrize('code', BLOCKS)
def test_python_of_the_readme_runs(start, code):
    """Each block is a whole program; one needs the arm, and prints where its hand is."""
    hand = ''
    if 'end_effector' in code:
        start(*ARM).line_with('t = 0')
        hand = 'geometry_msgs.msg.Vector3('
    process = start('-c', code)
    assert process.exit_code() == 0, process.output
    assert process.output.startswith(hand)
    assert process.output.count('\n') == bool(hand)


@pytest.mark.parametrize('signal_number', [signal.SIGINT, signal.SIGTERM])
def test_listen_hears_the_arm(start, signal_number):
    """`make demo` in one shell, `make listen` in another."""
    start(*ARM).line_with('t = 0')
    listener = start(str(ROOT / 'docs' / 'examples' / 'listen.py'))
    listener.line_with('map -> base_link')
    listener.line_with('joint_3 -> end_effector xyz  0.200  0.000  0.000')
    listener.end(signal_number)
    assert listener.exit_code() == 0
    assert 'Traceback' not in listener.output


@pytest.mark.parametrize('page', ['README.md', 'CONTRIBUTING.md'])
def test_links_lead_to_files(page):
    """Relative ones, of the pages that are read on disk."""
    links = re.findall(r'\]\((?!http)([^)#]+)\)', (ROOT / page).read_text())
    assert [link for link in links if not (ROOT / link).exists()] == []
