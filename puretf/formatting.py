"""
Functions that convert frame ids and times to printable text.

Frame ids are received from other programs and may contain control characters. To keep these
characters from the terminal, print `visible(name)` instead of `name`. Where there is little room,
print `shortened(name)`.
"""

from puretf._core.frames import dot_quoted
from puretf._core.texts import (
    abbreviated,
    comma_list,
    full_name,
    in_log,
    is_slip,
    LONGEST,
    may_be_one_robot,
    namespace_distance,
    namespace_path,
    near_names,
    quoted,
    SECTION_NAMES,
    see,
    shortened,
    suggest_names,
    TF_MESSAGE,
    visible,
    visible_lines,
    visible_name,
)
from puretf._core.times import display_time, exact_time, in_seconds, SECOND

__all__ = [
    'LONGEST',
    'SECOND',
    'SECTION_NAMES',
    'TF_MESSAGE',
    'abbreviated',
    'comma_list',
    'display_time',
    'dot_quoted',
    'exact_time',
    'full_name',
    'in_log',
    'in_seconds',
    'is_slip',
    'may_be_one_robot',
    'namespace_distance',
    'namespace_path',
    'near_names',
    'quoted',
    'see',
    'shortened',
    'suggest_names',
    'visible',
    'visible_lines',
    'visible_name',
]
