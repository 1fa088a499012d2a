"""
Names and times in texts: escaped, cut and rounded, as in the errors of this package.

Names of frames come from others: print `visible(name)`, or `shortened(name)` where there is little
room, and no control character of theirs reaches the terminal.
"""

from dummy_arm.tf._core.frames import dot_quoted
from dummy_arm.tf._core.texts import (
    abbreviated,
    comma_list,
    logged,
    LONGEST,
    match_candidates,
    quoted,
    shortened,
    suggest_names,
    visible,
    visible_lines,
)
from dummy_arm.tf._core.times import display, in_seconds, SECOND

__all__ = [
    'LONGEST',
    'SECOND',
    'abbreviated',
    'comma_list',
    'display',
    'dot_quoted',
    'in_seconds',
    'logged',
    'match_candidates',
    'quoted',
    'shortened',
    'suggest_names',
    'visible',
    'visible_lines',
]
