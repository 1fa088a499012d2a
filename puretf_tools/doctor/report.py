"""The report of all checks."""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
import os
from typing import Any, NamedTuple, Union

from puretf._causes.facts import listed
from puretf._text.names import comma_list, see, shortened, visible
from puretf._text.similar_names import suggest_names
from puretf.bag import Bag, Paths
from puretf.bag import open as open_bag
from puretf_tools.doctor.checks import CHECKS, diagnose, ERROR, Finding, not_checked
from puretf_tools.doctor.message_times import Verdict
from puretf_tools.doctor.observation import BagObserver, Observation
from puretf_tools.inspection.terminal import columns, wrapped


class Report(NamedTuple):
    """The findings of all checks; `str` returns the text that `tf_doctor` prints."""

    findings: list[Finding]  #: errors first, then warnings, then infos
    #: For each topic with headers, from when on its messages can be transformed at their stamps:
    #: 'topic', 'messages', 'judged' (at most 20 000), the shares (from 0 to 1) 'at_once',
    #: 'waiting' and 'never', the waits (s) 'median_wait', 'wait_of_95_percent' and 'largest_wait',
    #: and 'queue', the size that a MessageFilter needs.
    topics: list[dict[str, Any]]
    not_checked: list[str]  #: what could not be checked, and why
    verdict: str  #: the number of findings, of transforms and of frames, in one line
    clock: str = ''  #: that times are those of /clock, if they are

    @property
    def has_errors(self) -> bool:
        return any(finding.severity == ERROR for finding in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """Return a dict of plain values, as in the JSON of `tf_doctor`."""
        return {**self._asdict(), 'findings': [
            dict(zip(each._fields[:-2], each)) for each in self.findings]}

    def __str__(self) -> str:
        """Return the text that `tf_doctor` prints, wrapped at the width of a terminal."""
        lines = []
        for finding in self.findings:
            names = listed(finding.frames or finding.topics or finding.nodes)
            where = ', '.join(f'{word} {comma_list(each)}' for word, each in (
                ('on', finding.topics), ('by', finding.nodes)) if each)
            lines.append(visible(f'{finding.severity} {finding.code}{names and ": "}{names}'))
            for text in (f'{finding.evidence.rstrip(".")}.',
                         where and f'{where[0].upper()}{where[1:]}.',
                         (finding.remedy + see(finding.section)).strip()):
                lines += wrapped(visible(text), '    ') if text else []
            lines.append('')
        if self.topics:
            lines += [*columns([*_rows(self.topics)]), '']
        for text in (*(f'not checked: {text}' for text in self.not_checked), self.clock):
            lines += wrapped(visible(text)) if text else []
        return '\n'.join([*lines, *[''] * bool(self.not_checked), self.verdict])


def examine(observed: Union[Paths, Bag, Observation], *, ignore: Collection[str] = ()) -> Report:
    """
    Run all checks on the transforms of a bag.

    :param observed: an open bag, or the path of one, as for `puretf.bag.open`; or an
        `Observation`, such as one of a live system. The robots whose descriptions a bag has are
        checked, too.
    :param ignore: the codes of the checks to skip.
    :raises ValueError: if a code is unknown.
    :raises BagError: if the bag cannot be read, or has no topic with transforms.
    :raises OSError: if the file cannot be read.
    """
    check_codes(ignore)
    if not isinstance(observed, (Bag, Observation)):
        with open_bag(observed) as bag:
            return examine(bag, ignore=ignore)
    if isinstance(observed, Bag):
        observer = BagObserver()
        for message in observed.messages(headers=True, others=observer.wanted):
            observer.add(message)
        observed = observer.observation(observed)
    findings = diagnose(observed, ignore)
    counts = Counter(finding.severity for finding in findings)
    found = ', '.join(_count(count, severity) for severity, count in counts.items())
    topics = [] if 'headers' in observed.not_known else [
        topic.row() for topic in observed.message_times
        if topic.judged or topic.count(Verdict.ZERO_STAMP)]
    is_part = 'messages' in observed.not_known or observed.statistics.malformed
    nothing = 'nothing found' if is_part else 'healthy'
    verdict = (f'{found or nothing}: {_count(observed.statistics.count, "transform")} of '
               f'{_count(len(observed.tree_of), "frame")} {observed.where}')
    if {each.is_static for each in observed.tracks} == {True}:
        verdict += ', no dynamic transforms'
    return Report(findings, topics, [*not_checked(observed, ignore), *observed.left_out],
                  visible(verdict), observed.clock_text)


def examine_bag(bag: Paths, *, name: str = '', ignore: Collection[str] = (), **options: Any
                ) -> dict[str, Any]:
    """
    Examine one of many bags as `examine` does; this function and its result can be pickled.

    :param bag: the path of the bag, or the paths of its files.
    :param name: how texts call it, such as the address of a copy; '': by its path.
    :param options: the other arguments of `puretf.bag.open`.
    :returns: plain values: 'bag', its name, or the path of its directory or first file, and the
        items of `Report`; or, if the bag cannot be read, 'bag' and 'error', the text that says
        why.
    :raises ValueError: if a code is unknown.
    """
    check_codes(ignore)
    paths = [bag] if isinstance(bag, (str, os.PathLike)) else [*bag]
    path = str(paths[0]) if paths else ''
    try:
        with open_bag(paths, **options) as opened:
            found = examine(opened, ignore=ignore).as_dict()
    except OSError as error:
        found = {'error': f'cannot read {path}: {error.strerror or error}'}
    except Exception as error:  # whatever is wrong with one bag, the others are examined
        found = {'error': str(error) or type(error).__name__}
    text = 'error' if 'error' in found else 'verdict'
    return {'bag': name or path, **found,
            text: found[text].replace(path, name) if name and path else found[text]}


def check_codes(codes: Collection[str]) -> None:
    """Raise a ValueError if no check has one of the codes."""
    for code in codes:
        if code not in CHECKS:
            raise ValueError(
                f'unknown code {code!r}. {suggest_names(code, tuple(CHECKS), "codes")}')


def _rows(topics: Sequence[dict[str, Any]]) -> Iterator[Sequence[str]]:
    yield ('messages at their stamps', 'number', 'at once', 'after waiting', 'median', '95 %',
           'largest', 'never', 'queue')
    for topic in topics:
        waits = [f'{topic[wait]:.3g} s' if topic[wait] else '-' for wait in (
            'median_wait', 'wait_of_95_percent', 'largest_wait')]
        yield (shortened(topic['topic']), str(topic['messages']), f'{topic["at_once"]:.1%}',
               f'{topic["waiting"]:.1%}', *waits, f'{topic["never"]:.1%}',
               str(topic['queue'] or '-'))


def _count(number: int, noun: str) -> str:
    return f'{number} {noun}{"s" if number != 1 else ""}'
