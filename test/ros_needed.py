"""
Which tests need ROS: computed from what they, and the modules of this repository, import.

A module does that imports a ROS package as it is imported, itself or by what it imports. A test
does if its module does; or if it or a fixture of its own, with all of this repository's tests that
they name, imports such a thing later, has code that does in a string, runs a command where ROS is,
or asks for a ROS domain for a program of another kind.
"""

import ast
from collections.abc import Iterable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
import re
from textwrap import dedent
from typing import Optional

TESTS = Path(__file__).parent
_ROS = re.compile(r'rclpy|rosidl_\w+|tf2_\w+|\w+_(msgs|srvs|interfaces)')
#: In conftest: what runs a command where ROS is, and what runs one as if there was none.
_WITH_ROS, _WITHOUT_ROS = {'tool'}, {'tool_without', 'tool_without_ros'}


@cache
def _path_of(module: str) -> Optional[Path]:
    """Find a module of this repository."""
    root = TESTS.parent if module.partition('.')[0] == 'dummy_arm' else TESTS
    path = root.joinpath(*module.split('.'))
    return next(filter(Path.is_file, (path.with_suffix('.py'), path / '__init__.py')), None)


@cache
def _tree_of(module: str) -> ast.Module:
    path = _path_of(module)
    return ast.parse(path.read_text() if path else '')


def _at_import(node: ast.AST) -> Iterator[ast.AST]:
    """Walk over what is done when a module is imported."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            continue
        if isinstance(child, ast.If) and 'TYPE_CHECKING' in ast.unparse(child.test):
            for other in child.orelse:
                yield other
                yield from _at_import(other)
            continue
        yield child
        yield from _at_import(child)


def _of_package(package: str, name: str) -> str:
    """Tell which module a name of a package or module is imported from."""
    if _path_of(f'{package}.{name}'):
        return f'{package}.{name}'
    path = _path_of(package)
    if path and path.name == '__init__.py':  # which may import it when it is asked for
        late = getattr(import_module(package), '_MODULES', {})
        if name in late:
            return f'{package}.{late[name]}'
    return package


def _imported(nodes: Iterable[ast.AST]) -> Iterator[str]:
    """List the modules that nodes import."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (_of_package(node.module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Attribute) and re.fullmatch(
                r'dummy_arm(\.\w+)+', text := ast.unparse(node)):
            yield _of_package(*text.rsplit('.', 1))
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith('importorskip'):
            yield from (each.value for each in node.args
                        if isinstance(each, ast.Constant) and isinstance(each.value, str))


@cache
def _imported_at_import(module: str) -> frozenset[str]:
    """List the modules that one imports as it is imported, and its packages."""
    packages = {module.rsplit('.', count)[0] for count in range(1, module.count('.') + 1)}
    return frozenset({*packages, *_imported(_at_import(_tree_of(module)))})


@cache
def reaches_ros(module: str) -> bool:
    """Tell whether to import a module takes ROS."""
    found = [module]
    for name in found:
        if _path_of(name) is None and _ROS.fullmatch(name.partition('.')[0]):
            return True
        found += _imported_at_import(name).difference(found)
    return False


def _code_in(text: str) -> list[ast.AST]:
    """Parse a string that is a program, or the imports in one that is a part of it."""
    found: list[ast.AST] = []
    for part in [dedent(text)] if 'import' in text else []:
        for each in part, *re.findall(r'(?:^|[;\n])\s*((?:from|import) [^;\n]+)', part):
            try:
                found += ast.walk(ast.parse(each))
            except (SyntaxError, ValueError):
                continue
    return found


@cache
def _top_level(module: str) -> dict[str, object]:
    """List what a module of the tests defines, by name; or the module and name it has it from."""
    found: dict[str, object] = {}
    for node in _at_import(_tree_of(module)):
        if isinstance(node, ast.ImportFrom) and node.module:
            found.update({alias.asname or alias.name: (node.module, alias.name)
                          for alias in node.names})
    for node in _tree_of(module).body:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            found[node.name] = node
        for target in getattr(node, 'targets', [getattr(node, 'target', None)]):
            found.update({name.id: node for name in ast.walk(target or ast.Pass())
                          if isinstance(name, ast.Name)})
    return found


@cache
def _needs_ros(module: str, name: str) -> bool:
    """Tell whether what is defined in a module of the tests needs ROS when it is used."""
    found = [(module, name)]
    for where, what in found:
        node = _top_level(where).get(what)
        if where == 'conftest' and what in _WITH_ROS:
            return True
        if isinstance(node, tuple) and not node[0].startswith('dummy_arm') and _path_of(node[0]):
            found += {node}.difference(found)
        if not isinstance(node, ast.AST) or (where == 'conftest' and what in _WITHOUT_ROS):
            continue
        nodes = [*ast.walk(node)]
        for text in (each.value for each in nodes if isinstance(each, ast.Constant)):
            nodes += _code_in(text) if isinstance(text, str) else []
        asks = where != 'conftest' and any(
            each.arg == 'domain_id' for each in nodes if isinstance(each, ast.arg))
        if asks or any(map(reaches_ros, _imported(nodes))):
            return True
        found += {(where, each.id) for each in nodes if isinstance(each, ast.Name)}.difference(
            found)
    return False


def needs_ros(module: str, test: str, fixtures: Iterable[tuple[str, str]]) -> bool:
    """
    Tell whether a test needs ROS.

    :param module: the name of its module.
    :param test: its name, without parameters.
    :param fixtures: the modules and the names of the functions of its fixtures.
    """
    return reaches_ros(module) or any(
        _needs_ros(*each) for each in [(module, test), *fixtures] if _path_of(each[0]))
