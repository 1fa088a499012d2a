"""check_arm gives each of the hand-ins its grade, whatever the others and the machine do."""

from itertools import chain, zip_longest

from hand_ins import CHAOS, differences, MISTAKES, MODEL_ANSWER
from processes import BUSY, own_pids, tool
import psutil
import pytest

from dummy_arm.grading import processes

#: How long check_arm may take (s).
LONGEST = 1500.0


@pytest.fixture
def orphans():
    """Adopt the processes whose parents have ended; return them. After the test, kill them."""
    own = psutil.Process()
    before = {child.pid for child in own.children()}
    processes.become_subreaper()
    yield lambda: [each for each in own.children() if each.pid not in before | own_pids]
    processes.end_descendants(before | own_pids)
    processes.become_subreaper(False)


def test_hand_ins_on_a_busy_machine(start, tmp_path, orphans):
    """One row for each, with its cause; no process is left."""
    # Those of both kinds run side by side.
    both = filter(None, chain.from_iterable(zip_longest(MISTAKES.items(), CHAOS.items())))
    hand_ins = dict(both)
    folders = {name.removesuffix('.py'): hand_in for name, hand_in in {
        'model_first.py': MODEL_ANSWER, **hand_ins, 'model_last.py': MODEL_ANSWER}.items()}
    for name, hand_in in folders.items():
        (tmp_path / name).mkdir()
        hand_in.write(tmp_path / name / 'dummy_arm.py')
    for _ in range(2):  # cores
        start('-c', BUSY).line_with('busy')
    process = start(*tool('check_arm', '--csv', 'grades.csv', '--jobs', '4', *folders),
                    cwd=tmp_path)
    assert process.exit_code(LONGEST) == 1
    left = orphans()
    found = differences(folders, process.output, tmp_path / 'grades.csv')
    assert (found, left) == ({}, [])
    assert not process.has_left_processes()
