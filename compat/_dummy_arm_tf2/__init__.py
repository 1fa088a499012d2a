"""
Makes `import dummy_arm.tf` work, even if the user's program is called dummy_arm.py.

The other packages of this distribution import this one first. In a program dummy_arm.py, and in a
program beside such a file, `import dummy_arm` finds the program and not the package. `_load`
appends the directory of the package to the `__path__` of what `import dummy_arm` finds.
"""

from collections.abc import Sequence
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
import sys
from threading import RLock
from types import ModuleType
from typing import Any, Optional

_lock = RLock()


class _NotExecuted(ModuleType):
    """The user's program as a module; it is executed when the first of its names is used."""

    def __getattr__(self, name: str) -> Any:
        """Execute the program, unless Python itself asks for an attribute of the module."""
        if name.startswith('__') and name != '__all__':
            raise AttributeError(f'module {self.__name__!r} has no attribute {name!r}', name=name)
        self._execute()
        return getattr(self, name)

    def __setattr__(self, name: str, value: object) -> None:
        """Execute the program before one of its names is changed; the importer sets modules."""
        if not (name.startswith('__') or isinstance(value, ModuleType)):
            self._execute()
        ModuleType.__setattr__(self, name, value)

    def __dir__(self) -> list[str]:
        """Execute the program, and return its names."""
        self._execute()
        return dir(self)

    def _execute(self) -> None:
        with _lock:
            if type(self) is ModuleType:  # another thread has executed it
                return
            assert self.__spec__ is not None
            assert self.__spec__.loader is not None
            self.__class__ = ModuleType  # type: ignore[assignment]
            try:
                self.__spec__.loader.exec_module(self)
            except BaseException as error:
                self.__class__ = _NotExecuted
                if isinstance(error, AttributeError):  # hasattr would hide it
                    raise ImportError(f'{self.__file__} cannot be imported: {error}') from error
                raise


def _has_tf(path: Optional[Sequence[str]]) -> bool:
    """Return True if the `__path__` of a package has the subpackage `tf`."""
    return path is not None and PathFinder.find_spec('dummy_arm.tf', path) is not None


def _find_package() -> Sequence[str]:
    """Return the `__path__` of the package dummy_arm that has the subpackage `tf`."""
    searches: list[tuple[Any, Optional[Sequence[str]]]] = [
        (PathFinder, [directory]) for directory in sys.path if isinstance(directory, str)]
    searches += [(finder, None) for finder in sys.meta_path if finder is not PathFinder]
    for finder, path in searches:
        spec = finder.find_spec('dummy_arm', path)
        if spec is not None and _has_tf(spec.submodule_search_locations):
            locations: Sequence[str] = spec.submodule_search_locations
            return locations
    raise ModuleNotFoundError('the package dummy_arm is not installed; see its README')


def _load() -> None:
    """Make sure that `import dummy_arm.tf` finds the package."""
    module = sys.modules.get('dummy_arm')
    spec = None if module is not None else find_spec('dummy_arm')
    path = getattr(module, '__path__', None) if spec is None else spec.submodule_search_locations
    if _has_tf(path):
        return
    package = _find_package()
    if module is None:
        assert spec is not None  # else, `_find_package` has raised an error
        module = sys.modules['dummy_arm'] = module_from_spec(spec)
        module.__class__ = _NotExecuted
    module.__path__ = [*(path or ()), *package]


_load()
