"""Controls of the panels, what a viewer has set, and the numbers that viewers send."""

from collections.abc import Callable, Iterable
import json
from math import isfinite
from typing import Any, NamedTuple, Optional

import viser

#: The choice of no frame, and that of the frame that the program proposes.
NONE, AUTOMATIC = '(none)', '(automatic)'
#: The largest number of characters of what is restored.
_LONGEST = 50_000


class _Kept(NamedTuple):
    """A value that is kept."""

    read: Callable[[], Any]
    write: Callable[[Any], object]
    types: tuple[type, ...]  #: those that the value can have
    default: Any


class Settings:
    """What a viewer has set, by names such as the labels of controls."""

    def __init__(self) -> None:
        self._kept: dict[str, _Kept] = {}
        self._wanted: dict[str, Any] = {}  # what was restored last

    def add(self, name: str, read: Callable[[], Any], write: Callable[[Any], object],
            *types: type) -> None:
        """Add a value: `read` returns it, `write` sets it to a value of one of the types."""
        self._kept[name] = _Kept(read, write, types, read())
        self._restore(name)

    def control(self, control: Any) -> Any:
        """Add a control under its label, and return it."""
        kind = type(control.value)
        self.add(control.label, lambda: control.value,
                 lambda value: change(control, value=kind(value)),
                 *((int, float) if kind is float else (kind,)))
        return control

    def names(self, name: str) -> set[str]:
        """Add a set of names of frames, which is empty at first, and return it."""
        names: set[str] = set()

        def write(values: list[Any]) -> None:
            names.clear()
            names.update(each for each in values if isinstance(each, str))

        self.add(name, lambda: sorted(names), write, list)
        return names

    def as_json(self) -> str:
        """Return a line of JSON; `restore` takes it."""
        return json.dumps({**self._wanted, **{
            name: kept.read() for name, kept in self._kept.items()}})

    def restore(self, text: str) -> str:
        """Set what a line of JSON says, and return ''; or set nothing, and return why."""
        try:
            values = json.loads(text[:_LONGEST])
        except (ValueError, RecursionError) as error:
            return f'this is no view: {error}'
        if not isinstance(values, dict):
            return 'this is no view: it must be an object in JSON, as "Copy view" writes it'
        self._wanted = values
        for name in values:
            self._restore(name)
        return ''

    def reset(self) -> None:
        """Set all to what it was at first."""
        self._wanted = {}
        for kept in self._kept.values():
            kept.write(kept.default)

    def _restore(self, name: str) -> None:
        if (kept := self._kept.get(name)) and type(
                value := self._wanted.get(name, self)) in kept.types:
            kept.write(value)


class Setting:
    """
    The value of a control that viewers and the program set.

    viser stores what a viewer has set some time before it calls back. Meanwhile `show` must not
    put the old value back, so it writes only what differs from what it knows.
    """

    def __init__(self, control: Any, on_set: Callable[[Any], object]) -> None:
        """Call a function with each value that a viewer sets."""
        self._control, self._known, self._on_set = control, control.value, on_set
        control.on_update(self._on_update)

    @property
    def value(self) -> Any:
        """What a viewer or the program has set."""
        return self._known

    async def _on_update(self, event: 'viser.GuiEvent[Any]') -> None:
        if event.client_id is not None:
            self._known = event.target.value
            self._on_set(self._known)

    def show(self, value: object) -> None:
        """Set the value, as the program wants it."""
        if value != self._known:
            self._known = self._control.value = value

    def set_options(self, options: tuple[str, ...]) -> None:
        """Set the options of a dropdown; if its value is none of them, it becomes the first."""
        if options != self._control.options:
            self._control.options = options
            self._known = self._control.value


class FrameChoice:
    """A dropdown of frames; until a viewer chooses a frame, the program proposes one."""

    def __init__(self, gui: viser.GuiApi, label: str, none: str = NONE,
                 settings: Optional[Settings] = None) -> None:
        """Add a dropdown, in which `none` stands before the frames."""
        self._none = none
        self._dropdown = gui.add_dropdown(label, (none,))
        self._shown = Setting(self._dropdown, self.choose)
        self._chosen: Optional[str] = None
        self._proposal = ''
        if settings:
            settings.add(label, lambda: self._chosen, self._restore, str, type(None))

    @property
    def name(self) -> str:
        """The chosen or proposed frame; '' if there is none."""
        return self._proposal if self._chosen is None else self._chosen

    @property
    def chosen(self) -> str:
        """The frame that a viewer has chosen; '' if there is none."""
        return self._chosen or ''

    def choose(self, name: str) -> None:
        """Choose a frame, as if a viewer had selected it in the dropdown."""
        self._chosen = None if name == AUTOMATIC else '' if name == NONE else name

    def _restore(self, name: Optional[str]) -> None:
        self._chosen = name

    def set_options(self, names: Iterable[str]) -> None:
        """Set the frames; the chosen one stays, since it may be published again."""
        self._shown.set_options((self._none, *sorted({*names, self.chosen} - {''})))

    def propose(self, proposal: str) -> None:
        """Set the proposal, and show the frame that is chosen or proposed."""
        self._proposal = proposal
        shown = self.name or self._none
        if shown in self._dropdown.options:
            self._shown.show(shown)


def change(handle: Any, **values: Any) -> None:
    """Set those attributes of a control that differ: viser sends each that is set."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def within(value: Any, smallest: float, largest: float) -> float:
    """Clamp a number that a viewer has set; if it is not finite, return `smallest`."""
    number = float(value)
    return min(max(number, smallest), largest) if isfinite(number) else smallest
