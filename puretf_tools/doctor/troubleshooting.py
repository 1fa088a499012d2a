"""The page docs/troubleshooting.md: its sections, as text for a terminal."""

from collections.abc import Iterator
from pathlib import Path
import re

from puretf._causes.lookups import RULES
from puretf._text.names import SECTIONS
from puretf._text.similar_names import suggest_names
from puretf_tools.doctor.checks import CHECKS
from puretf_tools.inspection.terminal import columns, wrapped

_HERE = Path(__file__).resolve()
#: What has a code: causes of errors, and findings.
_CODES = {**RULES, **CHECKS}
#: The page is installed beside this module (see setup.py); in a checkout, it is in docs/.
_PAGES = _HERE.with_suffix('.md'), _HERE.parents[2] / 'docs' / 'troubleshooting.md'


def explained(words: str) -> str:
    """
    Return the sections that some words mean; without words, the names of all.

    The words are a short name, the code of a cause or finding, or words of headings.

    :raises ValueError: if they mean none.
    """
    if not words:
        return '\n'.join(columns([*SECTIONS.items()]))
    found = [words] if words in SECTIONS else [_CODES[words].section] if words in _CODES else [
        name for name, heading in SECTIONS.items()
        if all(word in heading.lower() for word in words.lower().split())]
    if not found:
        raise ValueError(f'no section explains {words!r}. '
                         f'{suggest_names(words, (*SECTIONS, *_CODES), "names")}')
    return '\n\n'.join('\n'.join(_section(SECTIONS[name])) for name in found)


def _section(heading: str) -> Iterator[str]:
    """Yield the lines of a section: wrapped paragraphs without links, and indented code."""
    page = next(path for path in _PAGES if path.exists()).read_text(encoding='utf-8')
    body = page.partition(f'\n## {heading}\n')[2].partition('\n## ')[0]
    yield heading
    for i, part in enumerate(body.split('```')):
        if i % 2:
            yield from ('', *(f'    {line}'.rstrip() for line in part.splitlines()[1:]))
            continue
        text = re.sub(r'\[(.*?)]\(.*?\)', r'\1', part, flags=re.DOTALL).replace('**', '')
        for paragraph in filter(None, text.strip().split('\n\n')):
            yield from ('', *wrapped(' '.join(paragraph.split())))
