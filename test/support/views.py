"""Views that a browser may have stored: right ones, odd ones and none, for Hypothesis."""

import json
from typing import Any

from hypothesis import strategies as st

#: Names of settings, and values that these can have.
RIGHT: dict[str, list[Any]] = {
    'Axis length (m)': [0.02, 1, 2.0], 'Frame timeout (s)': [1, 15.5, 60], 'Opacity': [0.1, 1],
    'Axes': [True, False], 'Grid': [False], 'Dark': [True], 'Follow its yaw': [True],
    'Show names': [None, False, True], 'Include': ['', 'a -b', r'(\w+)+!', '['],
    'Exclude': ['', 'base', '-map', '-'], 'Fixed frame': [None, '', 'base', 'nowhere', '<b>'],
    'Frame': ['map', '\n'], 'Trail of': ['base'], 'Follow': ['base'], 'A': ['map'], 'B': ['base'],
    'Hidden': [[], ['map', 'x']], 'Hidden branches': [['map']], 'Folded': [['map', 'base']],
    'Plot over': ['20 s', '2 min', 'whole bag'],
    'Camera': [[], [1, 2, 3, 0, 0, 0, 0.8], [0, 0, 0, 0, 0, 0, 3.1], [0, 0, 1e12, 0, 0, -1e12, 1]],
    'Time': [0, 1, 2**63 - 1]}

_NUMBERS = st.one_of(st.integers(), st.floats(), st.sampled_from([
    10**400, -10**400, 2**63, 2**64, 1e308, -1e308, 5e-324, float('nan'), float('inf')]))
_TEXTS = st.one_of(st.text(st.characters(exclude_categories=()), max_size=20),
                   st.sampled_from(['\ud800', '\0', '20 s', 'x' * 1025, 'é' * 513]))
_VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), _NUMBERS, _TEXTS),
    lambda inner: st.one_of(st.lists(inner, max_size=8), st.dictionaries(
        st.sampled_from(['x', 'y']), inner)), max_leaves=8)


@st.composite
def _near_right(draw, values):
    """Return a right value, of which one part may be another one."""
    value = json.loads(json.dumps(draw(st.sampled_from(values))))
    if isinstance(value, list) and value and draw(st.booleans()):
        value[draw(st.integers(0, len(value) - 1))] = draw(_VALUES)
    return value


_VIEWS = st.one_of(
    st.fixed_dictionaries({}, optional={
        name: st.one_of(_near_right(values), _near_right(values), _VALUES)
        for name, values in RIGHT.items()}),
    *(st.fixed_dictionaries({name: _VALUES}) for name in RIGHT))

#: Texts, most of which are JSON.
STORED = st.one_of(_VIEWS.map(json.dumps), _VIEWS.map(json.dumps), _VALUES.map(json.dumps),
                   st.text(max_size=30), st.sampled_from(['[' * 5000, '9' * 5000, '{"Frame": 1']))
