"""Texts of the panel that viewers copy."""

from collections.abc import Iterable
from html import escape
from shlex import quote

from puretf.formatting import visible
from puretf_tools.inspection.terminal import fixed_point
from puretf_tools.view.details import STYLE

#: A click selects the whole text.
_STYLE = f'{STYLE}; white-space: pre-wrap; user-select: all; -webkit-user-select: all'


def copied(text: str, key: str) -> str:
    """Return in HTML a text that a click selects."""
    return f'<pre style="{_STYLE}" data-text="{key}">{escape(text)}</pre>'


def command_line(parent: str, child: str, numbers: Iterable[tuple[str, float]]) -> str:
    """Return the command that publishes a transform; numbers: by option, such as x or yaw."""
    frames = ('frame-id', parent), ('child-frame-id', child)
    return ' '.join(['static_transform_publisher', *(
        f'--{option} {decimal(value)}' for option, value in numbers if value), *(
        # The parser takes a value that begins with a hyphen only after '='.
        f'--{option}{"=" if frame.startswith("-") else " "}{quote(visible(frame))}'
        for option, frame in frames)])


def decimal(value: float) -> str:
    """Write a number without an exponent, which YAML 1.1 reads as a text if there is no point."""
    digits = fixed_point(value, 9).rstrip('0')
    return f'{digits}0' if digits.endswith('.') else digits
