"""A picture of an arm, for a student's report."""

from math import degrees
from typing import TYPE_CHECKING

import numpy as np

from dummy_arm.grading.sheet import FRAMES, HAND, SHEET
from puretf import LookupException

if TYPE_CHECKING:
    from puretf import Buffer


def picture(buffer: 'Buffer') -> str:
    """
    Draw an arm as it is seen from above, the path of its hand, and a grid in metres, as SVG.

    :raises TransformException: if there is no stamp at which all frames of the arm are known.
    """
    stamps = buffer.path_stamps('map', HAND.name)
    parents = {frame.name: frame.parent for frame in buffer.frames()}
    names = [*FRAMES[1:], *(parents.get(name, 'map') for name in FRAMES[1:])]
    places = np.array([buffer.lookup_transforms('map', name, stamps)[0] for name in names])
    known = np.isfinite(places).all(axis=(0, 2))
    if not known.any():
        raise LookupException('there is no stamp at which all frames of the arm are known in map')
    places = places[:, known]
    path, (ends, begins) = places[SHEET.index(HAND)], np.split(places[:, -1], 2)
    # Beside a point, there must be space for the name of a frame.
    size = round(max(1.6 * float(abs(places[..., :2]).max()), 0.1), 3)
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" width="600" viewBox="{-size} {-size} '
             f'{2 * size} {2 * size}" font-size="{size / 20:.3f}" stroke-width="{size / 60:.3f}" '
             'stroke-linecap="round">',
             '<title>The arm from above, and the path of its hand; grid in m</title>']
    for tick in float(f'{size / 5:.1g}') * np.arange(-3, 4):
        lines.append(f'<path d="M{tick:g} {-size}V{size}M{-size} {-tick:g}H{size}" stroke="#eee" '
                     f'stroke-width="{size / 200:.3f}"/><text x="{tick:g}" y="{size}">{tick:g} m'
                     f'</text><text x="{-size}" y="{-tick:g}">{tick:g} m</text>')
    for points, color in (path, '#ccc'), *((each, '#06c') for each in zip(begins, ends)):
        line = ' '.join(f'{x:.3f},{-y:.3f}' for x, y, _ in points)
        lines.append(f'<polyline points="{line}" fill="none" stroke="{color}"/>')
    for edge, (x, y, _) in zip(SHEET[1:], ends[1:]):
        limit = f' ±{degrees(edge.limit):.0f}°' if edge.limit else ''
        lines.append(f'<text x="{x + size / 40:.3f}" y="{-y:.3f}">{edge.name}{limit}</text>')
    return '\n'.join([*lines, '</svg>', ''])
