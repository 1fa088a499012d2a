"""The ends of a listener, fifty times each, and with delays."""

from concurrent.futures import ThreadPoolExecutor

from endings import check_end, end_in_every_order, without_library_lines
from environment import ROOT
from processes import Process, reserved_domain
import pytest


@pytest.mark.parametrize('where', ['main', 'executor', 'thread'])
def test_every_order_of_ending(domain_id, capfd, where):
    """unregister, destroy_node and shutdown end a listener in any order, in any thread."""
    for _ in range(50):
        end_in_every_order(domain_id, where)
    assert without_library_lines(capfd.readouterr().err) == ''


@pytest.mark.parametrize('way', ['end', 'exit', 'spin', 'lookup'])
def test_the_end_of_a_program(start, way):
    """A program ends cleanly by its last line, sys.exit(), and by Ctrl-C in a spin or a lookup."""
    for _ in range(50):
        check_end(start, way)


@pytest.mark.parametrize(('longest', 'ends', 'seeds'), [
    (2.0, 5, range(20)), *((0.7, 20, range(i, i + 20)) for i in range(0, 100, 20))])
def test_ends_with_delays(longest, ends, seeds):
    """Each step of an end takes up to `longest` s more, at random; twenty processes at a time."""
    results = []

    def run(seed):
        for domain in reserved_domain():
            process = Process(domain, str(ROOT / 'test/support/late_ends.py'),
                              *map(str, (seed, ends, longest, domain)))
            code = process.exit_code(1200)
            results.append((code, process.has_left_processes(),
                            without_library_lines(process.output)))
            process.close()

    with ThreadPoolExecutor(len(seeds)) as pool:
        [*pool.map(run, seeds)]
    assert results == [(0, False, '')] * len(seeds)
