"""The sections of the pages that take minutes: they install packages, or start many programs."""

from pages import bag_of_a_walk, LONG, run_section, SECTIONS  # noqa: F401
import pytest


def test_the_long_sections_exist():
    """A section that is renamed must be renamed here, too."""
    assert {*SECTIONS} >= LONG


@pytest.mark.parametrize(('page', 'section'), sorted(LONG))
def test_commands_run(start, bag_of_a_walk, page, section):  # noqa: F811
    """Each command ends with exit code 0, by itself or after Ctrl-C."""
    run_section(start, bag_of_a_walk, page, section)
