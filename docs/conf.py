"""The settings of Sphinx: `make docs` builds these pages and the reference into `build/docs`."""

from importlib.metadata import metadata
import re
from typing import Any

from sphinx.util.logging import getLogger

import puretf
from puretf import bag
from puretf_tools import doctor, robot

_metadata = metadata('dummy_arm')
project = _metadata['Name']
release = _metadata['Version']

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.viewcode']
exclude_patterns = ['examples']
html_theme = 'furo'
html_title = f'{project} {release}'
html_copy_source = False
html_show_copyright = False

# Links of the pages to headings, such as (library.md#without-ros).
myst_heading_anchors = 3

# In docstrings, `name` is code; of the same class or module, and of puretf, also a link.
default_role = 'py:obj'
smartquotes_action = 'De'  # dashes, but no quotes: they are part of Python
add_module_names = False
toc_object_entries_show_parents = 'hide'
autodoc_default_options = {
    'inherited-members': 'BaseException, Exception, bytes, int, object, tuple',
    'members': True,
    'show-inheritance': True,
}
autoclass_content = 'both'
autodoc_member_order = 'bysource'
autodoc_typehints = 'description'
autodoc_type_aliases = {'ArrayLike': 'ArrayLike'}
autodoc_typehints_description_target = 'documented'
autodoc_preserve_defaults = True


def setup(app: Any) -> None:
    """Connect the functions of this file to the events of Sphinx."""
    app.connect('source-read', _link_to_repository)
    app.connect('autodoc-process-bases', _drop_private_bases)
    app.connect('autodoc-process-docstring', _change_docstring)
    app.connect('env-check-consistency', _find_missing_names)


def _link_to_repository(_app: Any, _name: str, source: list[str]) -> None:
    """Let links to files that are not in this directory lead to the repository."""
    source[0] = source[0].replace('](../', f']({_metadata["Home-page"]}/blob/main/')


def _drop_private_bases(_app: Any, _name: str, _object: Any, _options: Any, bases: list[Any]
                        ) -> None:
    bases[:] = [base for base in bases if '._' not in getattr(base, '__module__', '')] or [object]


def _change_docstring(_app: Any, _kind: str, _name: str, _object: Any, _options: Any,
                      lines: list[str]) -> None:
    """Let names of puretf be links, and drop the docstrings that NamedTuple writes."""
    lines[:] = [re.sub(r'(?<!`)`((\w+)(\.\w+)?)`(?!`)', _link_to_name, line) for line in lines
                if not line.startswith(('Alias for field number', 'Create new instance of'))]


def _link_to_name(match: re.Match[str]) -> str:
    return f'`{match[1]} <puretf.{match[1]}>`' if match[2] in puretf.__all__ else match[0]


def _find_missing_names(_app: Any, environment: Any) -> None:
    """Warn of public names that the reference lacks."""
    found = environment.domains.python_domain.objects
    for module in doctor, robot, puretf, bag:
        for name in module.__all__:
            if f'{module.__name__}.{name}' not in found:
                getLogger(__name__).warning('%s.%s is not in the reference', module.__name__, name)
