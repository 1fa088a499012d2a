"""A picture of an arm, for a student's report."""

from dummy_arm.grading.sheet import FRAMES, HAND
from puretf import Buffer


def picture(buffer: Buffer) -> str:
    """
    Draw an arm as it is seen from above, and the path of its hand, as SVG.

    :raises TransformException: if a frame of the arm is missing.
    :raises IndexError: if nothing is known of the hand.
    """
    stamps = buffer.path_stamps('map', HAND.name)
    path, _, known = buffer.lookup_transforms('map', HAND.name, stamps)
    path, stamps = path[known], stamps[known]
    arm = [buffer.lookup_transforms('map', name, [stamps[-1]])[0][0] for name in FRAMES[1:]]
    size = round(1.2 * float(abs(path[:, :2]).max()), 3)
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" width="600" viewBox="{-size} {-size} '
             f'{2 * size} {2 * size}" font-size="{size / 20:.3f}" stroke-width="{size / 60:.3f}">',
             '<title>The arm from above, and the path of its hand</title>']
    for points, color in (path, '#ccc'), (arm, '#06c'):
        places = ' '.join(f'{x:.3f},{-y:.3f}' for x, y, _ in points)
        lines.append(f'<polyline points="{places}" fill="none" stroke="{color}"/>')
    lines += [f'<text x="{x + size / 40:.3f}" y="{-y:.3f}">{name}</text>'
              for name, (x, y, _) in zip(FRAMES[2:], arm[1:])]
    return '\n'.join([*lines, '</svg>', ''])
