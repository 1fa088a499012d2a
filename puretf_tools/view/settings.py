"""What a viewer has set, which values each setting can have, and a line of JSON with all of it."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
import json
from math import pi
from typing import Any, NamedTuple, TYPE_CHECKING

from puretf._text.names import abbreviated, LONGEST_NAME

if TYPE_CHECKING:
    import viser

#: The ranges of sliders, by their labels.
_RANGES = {'Axis length (m)': (0.02, 2.0), 'Frame timeout (s)': (1.0, 60.0), 'Opacity': (0.1, 1.0)}
#: What the pair is plotted over: the last seconds; 0: the whole bag.
SPANS = {'20 s': 20, '2 min': 120, 'whole bag': 0}
#: The largest coordinate of a camera (m), and the largest stamp (ns).
_FARTHEST, _LATEST = 1e12, 2**63 - 1
_LONGEST_SHOWN = 60  # characters of a value that is refused
_REMEDY = 'copy the line that "copy view" shows'


def _is_number(value: Any, lower: float, upper: float) -> bool:
    # In Python, integers of any size are compared exactly, and NaN is in no range.
    return type(value) in (int, float) and lower <= value <= upper


def _is_text(value: Any) -> bool:
    with suppress(UnicodeEncodeError):  # lone surrogates, which cannot be sent
        return type(value) is str and len(value.encode()) <= LONGEST_NAME
    return False


def _is_camera(value: Any) -> bool:
    return value == [] or (type(value) is list and len(value) == 7 and all(
        _is_number(each, -_FARTHEST, _FARTHEST) for each in value[:6]) and _is_number(
            value[6], 1e-3, pi))


#: By the names of settings, such as the labels of controls: whether a setting can have a value.
_KINDS: dict[str, Callable[[Any], bool]] = {
    **{label: partial(_is_number, lower=lower, upper=upper)
       for label, (lower, upper) in _RANGES.items()},
    **dict.fromkeys(('Axes', 'Lines to parents', 'Grid', 'Dark', 'Follow its yaw', 'Visual',
                     'Collision'), lambda value: type(value) is bool),
    'Show names': lambda value: type(value) in (bool, type(None)), 'Include': _is_text,
    **dict.fromkeys(('Fixed frame', 'Frame', 'Trail of', 'Follow', 'A', 'B'),
                    lambda value: value is None or _is_text(value)),
    **dict.fromkeys(('Hidden', 'Hidden branches', 'Folded'),
                    lambda value: type(value) is list and all(map(_is_text, value))),
    'Plot over': lambda value: type(value) is str and value in SPANS, 'Camera': _is_camera,
    'Time': lambda value: type(value) is int and 0 <= value <= _LATEST}


class _Kept(NamedTuple):
    read: Callable[[], Any]
    write: Callable[[Any], object]
    default: Any


class Settings:
    """What a viewer has set, by names such as the labels of controls."""

    def __init__(self, first: str = '') -> None:
        """Let `reset` begin with what a line of JSON says, if there is one."""
        self._first = first
        self._kept: dict[str, _Kept] = {}

    def add(self, name: str, read: Callable[[], Any], write: Callable[[Any], object]) -> None:
        """Add a value: `read` returns it, `write` sets it to one that fits."""
        self._kept[name] = _Kept(read, write, read())

    def control(self, control: Any) -> Any:
        """Add a control under its label, and return it."""
        def write(value: Any) -> None:
            if value in getattr(control, 'options', (value,)):  # a bag has others than a live page
                control.value = value

        self.add(control.label, lambda: control.value, write)
        return control

    def slider(self, gui: 'viser.GuiApi', label: str, step: float, value: float) -> Any:
        """Create a slider with the range of a setting."""
        return self.control(gui.add_slider(label, *_RANGES[label], step, value))

    def names(self, name: str) -> set[str]:
        """Add a set of names of frames, which is empty at first, and return it."""
        names: set[str] = set()

        def write(values: list[str]) -> None:
            names.clear()
            names.update(values)

        self.add(name, lambda: sorted(names), write)
        return names

    def as_json(self) -> str:
        """Return a line of JSON; `restore` takes it, so what does not fit is left out."""
        values = {name: kept.read() for name, kept in self._kept.items()}
        return json.dumps({name: value for name, value in values.items()
                           if _KINDS[name](value)})

    def restore(self, text: str) -> str:
        """Set what a line of JSON says, and return ''; or set nothing, and return why."""
        values = None
        with suppress(ValueError, RecursionError):
            values = json.loads(text)
        if not isinstance(values, dict):
            return f'this is no view: {_REMEDY}'
        known = {name: value for name, value in values.items() if name in _KINDS}
        for name, value in known.items():
            if not _KINDS[name](value):
                shown = abbreviated(json.dumps(value), _LONGEST_SHOWN)
                return f'{name} cannot be {shown}: {_REMEDY}'
        for name in known.keys() & self._kept.keys():
            self._kept[name].write(known[name])
        return ''

    def reset(self, text: str = '') -> str:
        """Set all to what a line of JSON says, or else to what it was at first; see `restore`."""
        for kept in self._kept.values():
            kept.write(kept.default)
        why = self.restore(text) if text else ''
        if why or not text:
            self.restore(self._first or '{}')
        return why
