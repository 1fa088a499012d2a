"""Check whether a drawing of view_frames shows the tree of the lab's arm."""

from collections import defaultdict
from itertools import pairwise
import logging
from pathlib import Path
import re
from unicodedata import normalize

from dummy_arm.grading.causes import misspelling
from dummy_arm.grading.records import Grade, Verdict
from dummy_arm.grading.sheet import FRAMES
from puretf._text.names import comma_list, quoted

#: The lines of frames.pdf that are not the name of a frame, as this package and tf2 write them.
_LABEL = re.compile(r'Broadcaster: |Average rate: |Buffer length: |Most recent transform: |'
                    r'Oldest transform: |Recorded at time: |view_frames Result$|static$')


def judge(path: Path) -> Grade:
    """Judge whether a PDF of view_frames shows the arm."""
    try:
        fault = _fault(path)
    except ImportError:
        return Grade(str(path), None, 'pypdf is needed to read a PDF: apt install python3-pypdf, '
                     'or pip install pypdf.', Verdict.NOT_JUDGED)
    return Grade(str(path), None, fault, Verdict.NOT_OK if fault else Verdict.OK)


def _fault(path: Path) -> str:
    """Return what is wrong with the texts, and their places on the paper; '' if nothing is."""
    from pypdf import PdfReader
    #: By the place on the paper. A text is in several parts if it has a ligature, such as "ff".
    texts: defaultdict[tuple[float, float], str] = defaultdict(str)

    def add(text: str, outer: list[float], inner: list[float], *_: object) -> None:
        # A matrix a, b, c, d, e, f maps (x, y) to (a x + c y + e, b x + d y + f); inner is first.
        a, b, c, d, e, f = outer
        x, y = inner[4:]
        texts[-(b * x + d * y + f), a * x + c * y + e] += normalize('NFKC', text)

    logging.getLogger('pypdf').setLevel(logging.CRITICAL)  # its warnings about damaged files
    try:
        PdfReader(path).pages[0].extract_text(visitor_text=add)
    except OSError as error:
        return f'It cannot be read: {error.strerror}.'
    except Exception:  # a damaged file causes errors of many types
        texts.clear()
    names = {text.strip(): depth for (depth, _), text in sorted(texts.items())
             if text.strip() and not _LABEL.match(text.strip())}
    if not names:
        return 'It is not a PDF with text that can be read.'
    missing = [name for name in FRAMES if name not in names]
    others = [name for name in names if name not in FRAMES]
    if spellings := [text for name in missing if (text := misspelling(name, others))]:
        return ' '.join(spellings)
    if missing or others:
        return ' '.join(f'{label}: {comma_list(found, quoted)}.' for label, found in (
            ('Missing', missing), ('Other frames', others)) if found)
    for upper, lower in pairwise(FRAMES):
        if names[lower] < names[upper] + 1.0:
            return f'{lower} is not below {upper}: the tree is not a chain in the right order.'
    return ''
