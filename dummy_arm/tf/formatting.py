"""
Functions that format frame ids and times for output, as in the error texts of this package.

Frame ids are received from other programs and may contain control characters. Print
`visible(name)`, or `shortened(name)` where there is little room, so that none of these characters
reaches the terminal.
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
from dummy_arm.tf._core.times import display_time, in_seconds, SECOND

__all__ = [
    'LONGEST',
    'SECOND',
    'abbreviated',
    'comma_list',
    'display_time',
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
