"""Views that a browser may have stored."""

from typing import Any

#: Names of settings, and values that these can have.
RIGHT: dict[str, list[Any]] = {
    'Axis length (m)': [0.02, 1, 2.0], 'Frame timeout (s)': [1, 15.5, 60], 'Opacity': [0.1, 1],
    'Axes': [True, False], 'Grid': [False], 'Dark': [True], 'Follow its yaw': [True],
    'Show names': [None, False, True], 'Include': ['', 'a -b', r'(\w+)+!', '['],
    'Fixed frame': [None, '', 'base', 'nowhere', '<b>'],
    'Frame': ['map', '\n'], 'Trail of': ['base'], 'Follow': ['base'], 'A': ['map'], 'B': ['base'],
    'Hidden': [[], ['map', 'x']], 'Hidden branches': [['map']], 'Folded': [['map', 'base']],
    'Plot over': ['20 s', '2 min', 'whole bag'],
    'Camera': [[], [1, 2, 3, 0, 0, 0, 0.8], [0, 0, 0, 0, 0, 0, 3.1], [0, 0, 1e12, 0, 0, -1e12, 1]],
    'Time': [0, 1, 2**63 - 1]}
