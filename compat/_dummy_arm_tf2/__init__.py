"""
Makes `import dummy_arm.tf` work, even if the user's program is called dummy_arm.py.

The other packages of this distribution import this one first. Python searches the directory of a
program before all others. In a program dummy_arm.py, or in one beside it, `import dummy_arm` would
therefore import that program.
"""

from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import module_from_spec
from pathlib import Path
import sys
from typing import Optional


def _is_shadowing(directory: str) -> bool:
    """Return True if `import dummy_arm` would find a program in a directory, not a package."""
    return Path(directory, 'dummy_arm.py').is_file() and not Path(directory, 'dummy_arm').is_dir()


def _find_package() -> ModuleSpec:
    """
    Find the package dummy_arm that contains `tf`.

    :returns: the spec of the package.
    :raises ImportError: if it is not installed.
    """
    path = [directory for directory in sys.path if not _is_shadowing(directory)]
    for finder in sys.meta_path:
        spec: Optional[ModuleSpec] = finder.find_spec(
            'dummy_arm', path if finder is PathFinder else None)
        if spec is not None and any(Path(directory, 'tf').is_dir() for directory in
                                    spec.submodule_search_locations or ()):
            return spec
    raise ImportError('the package dummy_arm is not installed; see its README')


def _load() -> None:
    """
    Put the package dummy_arm into `sys.modules`.

    If a program or a package of the user with the name dummy_arm is there already, it stays there,
    and `tf` becomes a submodule of it.

    :raises ImportError: if the package is not installed.
    """
    if 'dummy_arm.tf' in sys.modules:
        return
    package = _find_package()
    module = sys.modules.get('dummy_arm')
    if module is None:
        module = sys.modules['dummy_arm'] = module_from_spec(package)
        assert package.loader is not None
        package.loader.exec_module(module)
    elif package.origin != getattr(module, '__file__', None):
        module.__path__ = [*getattr(module, '__path__', ()),
                           *(package.submodule_search_locations or ())]


_load()
