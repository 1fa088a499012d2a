"""The imports of Python files, read from their source."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Optional

from environment import ROOT, ROS

import puretf

#: The packages of the project.
PACKAGES = 'puretf', 'puretf_tools', 'dummy_arm'


@cache
def modules() -> dict[str, Path]:
    """Return the file of each module of the packages, by its name."""
    found = {}
    for path in sorted(path for name in PACKAGES for path in (ROOT / name).rglob('*.py')):
        parts = path.relative_to(ROOT).with_suffix('').parts
        found['.'.join(parts[:-1] if parts[-1] == '__init__' else parts)] = path
    return found


def _nodes(tree: ast.AST, is_late: bool) -> Iterator[ast.AST]:
    """
    Yield the nodes of a tree, but not those for type checkers only.

    :param is_late: whether to yield those in functions, too, which run later than the import.
    """
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and 'TYPE_CHECKING' in ast.unparse(node.test):
            continue
        yield node
        if is_late or not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            yield from _nodes(node, is_late)


@cache
def imported(path: Path, is_late: bool = True) -> frozenset[str]:
    """
    Return the modules that a file imports, and of puretf the names: 'puretf:Buffer'.

    :param is_late: whether to return those that it imports in functions, too.
    """
    found = set()
    for node in _nodes(ast.parse(path.read_text()), is_late):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.module, f'a relative import in {path}'
            for alias in node.names:
                name = f'{node.module}.{alias.name}'
                found.add(name if name in modules() else node.module)
                if node.module == 'puretf' and alias.name in puretf._MODULES:
                    found.add(f'puretf:{alias.name}')
    return frozenset(found)


def file_of(name: str) -> Optional[Path]:
    """Return the file of a module of the package or the tests, or of a name of puretf."""
    if name.startswith('puretf:'):
        name = f'puretf.{puretf._MODULES[name.partition(":")[2]]}'
    beside = ROOT / 'test' / 'support' / f'{name}.py'
    return modules().get(name) or (beside if beside.exists() else None)


def reached(path: Path, is_late: bool = True) -> set[str]:
    """
    Return the modules that a file imports, directly or through other modules of the package.

    :param is_late: as for `imported`.
    """
    found: set[str] = set()
    waiting = [path]
    while waiting:
        for name in imported(waiting.pop(), is_late) - found:
            found.add(name)
            if file := file_of(name):
                waiting.append(file)
    return found


def of_ros(names: set[str]) -> set[str]:
    """Return those of some modules that come with ROS."""
    return {name for name in names if name.startswith(ROS)}
