"""The form of a rule, which finds one cause in facts."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from operator import attrgetter
import re
from types import MappingProxyType
from typing import Any, NamedTuple, Optional


class Evidence(NamedTuple):
    """What satisfies a rule."""

    text: str  #: what was observed, as a sentence without its period
    values: Mapping[str, object] = MappingProxyType({})  #: those of the braces in the remedy
    nodes: Sequence[str] = ()  #: the full names of the nodes that it names
    topics: Sequence[str] = ()  #: the topics that it names
    frames: Sequence[str] = ()  #: the frames, if `tf_doctor` is to list them


class Rule(NamedTuple):
    """A rule: it finds one cause of a symptom, or one kind of fault."""

    code: str  #: the cause, such as 'changing_parent'
    remedy: str  #: what to do, in one sentence; in braces: values of the evidence
    section: str  #: the short name of one in docs/troubleshooting.md
    #: Returns the evidence for each time that the facts satisfy the rule.
    find: Callable[[Any], Iterable[Any]]
    symptoms: Collection[str] = ()  #: the symptoms of a lookup that it explains; see `facts`
    needs: Collection[str] = ()  #: what must be known
    explains: Collection[str] = ()  #: the codes of its consequences, which are left out
    #: True if it listens to topics for a moment, or looks at other processes.
    is_costly: bool = False
    #: False if only the process of the lookup can know it, so that tf_doctor cannot.
    is_on_wire: bool = True
    severity: str = 'error'  #: in `tf_doctor`; or 'warning' or 'info'
    meaning: str = ''  #: in `tf_doctor`: what it finds

    @property
    def advice(self) -> str:
        """The remedy without values."""
        return re.sub(r'{(\w+)}', r'the \1', self.remedy)


class Cause(NamedTuple):
    """A rule that is satisfied."""

    code: str
    text: str  #: the evidence and the remedy as sentences
    section: str


def registry(rules: dict[str, Rule]) -> Callable[..., Callable[[Any], Any]]:
    """Return a decorator that makes a rule of a function and its arguments, and adds it."""
    def rule(code: str, remedy: str, section: str, symptoms: Collection[str] = (), **fields: Any
             ) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
        def add(find: Callable[..., Any]) -> Callable[..., Any]:
            assert code not in rules
            fields.setdefault('meaning', find.__doc__ or '')
            rules[code] = Rule(code, remedy, section, find, symptoms, **fields)
            return find

        return add

    return rule


def known(rules: Iterable[Rule], not_known: Collection[str]) -> list[Rule]:
    """Return the rules for which all is known that they need."""
    return [rule for rule in rules if not any(need in not_known for need in rule.needs)]


def first_cause(rules: Iterable[Rule], facts: Any) -> Optional[Cause]:
    """
    Return the most certain cause of a symptom; None if none is known.

    What is costly is only asked if no other rule is satisfied.

    :param facts: the argument of the rules.
    """
    not_known = () if facts.around.topics else ('listener',)
    for rule in sorted(known(rules, not_known), key=attrgetter('is_costly')):
        for evidence in rule.find(facts) if facts.symptom in rule.symptoms else ():
            text = f'{evidence.text}. {rule.remedy.format(**evidence.values)}'
            return Cause(rule.code, text.strip(), rule.section)
    return None
