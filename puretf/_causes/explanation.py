"""What follows tf2's words in the text of an error: facts, a cause and its remedy, a section."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
import re

from puretf._causes.facts import Facts, listed, Look, RECENT, Surroundings
from puretf._causes.lookups import RULES
from puretf._causes.rules import first_cause
from puretf._text.names import quoted, see, shortened
from puretf._text.similar_names import near_names, suggest_names
from puretf._text.times import exact_time, SECOND

#: The sections that follow if no cause is known; of other symptoms, that of a missing frame.
_SECTIONS = {'unconnected': 'two_trees', 'past': 'past',
             'future': 'future', 'cleared': 'jump_back'}


def explain(facts: Facts) -> tuple[str, tuple[str, ...]]:
    """Return the text, and the code of the cause that it names."""
    # Without a listener, no rule could blame anything else.
    if facts.symptom == 'missing' and facts.around.topics and _is_typo(
            facts.names[0], tuple(facts.buffer.names)):
        facts = replace(facts, symptom='typo')
    cause = first_cause(RULES.values(), facts)
    if cause is None:
        return f'{_known(facts)}{_arrivals(facts)}{_without_cause(facts)}', ()
    # Any other cause says itself when the data arrive, if that matters.
    arrivals = _arrivals(facts) if cause.code == 'too_soon' else ''
    return f'{_known(facts)}{arrivals} {cause.text}{see(cause.section)}'.lstrip(), (cause.code,)


@lru_cache(maxsize=8)  # as `suggest_names`
def _is_typo(name: str, names: tuple[str, ...]) -> bool:
    """Return whether a name is almost that of a frame; other numbers are on purpose."""
    return any(re.findall(r'\d+', near) == re.findall(r'\d+', name)
               for near in near_names(name, names, cutoff=0.8))


def _known(facts: Facts) -> str:
    """Return the facts in one or two sentences."""
    around, edge, names = facts.around, facts.edge, facts.names
    if facts.symptom == 'cleared':
        return (f'No transform of {quoted(names[0])} has been received since the buffer was '
                'cleared, or mended after an interrupted insertion.')
    if facts.symptom == 'unconnected':
        target, source, target_root, source_root = map(quoted, (*names, *facts.roots))
        return (f'{target} is in the tree with root {target_root}, {source} in the tree with root '
                f'{source_root}.')
    if edge.child:
        span = (f'are from {exact_time(edge.oldest)} to {exact_time(edge.latest)}'
                if edge.oldest != edge.latest else f'are all at {exact_time(edge.latest)}')
        where = (f' and end {exact_time(facts.time - edge.latest)} s before that time'
                 if facts.time > edge.latest else
                 f' and begin {exact_time(edge.oldest - facts.time)} s after that time'
                 if facts.time < edge.oldest else '')
        return f'The data of edge {quoted(edge.parent)} -> {quoted(edge.child)} {span}{where}.'
    texts = [suggest_names(name, tuple(facts.buffer.names)) for name in names]
    if around.topics and not around.has_data:
        nodes = sorted({each.node for each in around.publishers or ()})
        texts += (['The listener has just started; discovery can take some seconds.']
                  if around.is_new else
                  [f'Nothing has arrived yet from {listed(nodes)}.'] if nodes else [])
    return ' '.join(texts)


def _arrivals(facts: Facts) -> str:
    """Say when and from whom the last transform has come, if it is not the usual way."""
    around, edge = facts.around, facts.edge
    if not edge.child or not around.topics:
        return ''
    if not facts.arrives:
        node, topic = around.node_of(edge.authority), around.topics[-1]
        who = (f' from {shortened(node)}' if node else
               f'; on {topic} now: {listed(around.nodes(topic)) or "no publisher"}')
        return f' The last one arrived {edge.silence / SECOND:.1f} s ago{who}.'
    if edge.stalled > RECENT:
        return f' Its stamp has not advanced for {edge.stalled / SECOND:.1f} s.'
    return '' if abs(facts.offset) <= RECENT else (
        f' Data arrive {abs(facts.offset) / SECOND:.1f} s '
        f'{"ahead of" if facts.offset > 0 else "behind"} the clock of this node.')


def _without_cause(facts: Facts) -> str:
    """Say more of an early time, and where to read on."""
    edge, text, section = facts.edge, '', _SECTIONS.get(facts.symptom, 'missing_frame')
    if edge.child and not edge.has_dropped:
        if facts.symptom == 'past':
            text = ' No earlier transform was received.'
        if edge.oldest == edge.latest:
            section = 'one_time'
    text += see(section)
    if facts.around.topics and len(facts.names) == 2 and all(
            re.fullmatch(r'[\w./-]+', name) for name in facts.names):
        text += f'; tf_doctor {" ".join(facts.names)}'
    return text


# The ends of log lines, which have no period yet


def publisher_end(look: Look, authority: str, is_static: bool) -> str:
    """Name the publisher of a transform, or all of its topic; '' if none is known."""
    around = look()
    if node := around.node_of(authority):
        return f'. Publisher: {shortened(node)}.'
    topic = around.topics[0 if is_static else -1] if around.topics else ''
    nodes = listed(around.nodes(topic))
    return nodes and f'. Publishers on {topic}: {nodes}.'


def old_data_end(look: Look, authority: str) -> str:
    return f'{publisher_end(look, authority, False) or "."}{see("old_data")}'


def clock_publishers(nodes: Sequence[str]) -> str:
    """Name the publishers of /clock; several make the time jump."""
    if len(nodes) == 1:
        return f' Publisher of /clock: {shortened(nodes[0])}.'
    around = Surroundings(clock_nodes=nodes, is_simulated=True)
    return f' {text_of("two_clocks", Facts("cleared", around))}'.rstrip()


def text_of(code: str, facts: Facts) -> str:
    """Return the text of one cause; '' if it is none."""
    cause = first_cause([RULES[code]], facts)
    return cause.text if cause else ''


# Without a lookup


#: Why transforms may not arrive on the topics of a listener.
_OF_TOPICS = ('wrong_type', 'volatile_listener', 'static_not_latched', 'incompatible_qos',
              'other_namespace')


def why_not_received(around: Surroundings) -> str:
    """Return why transforms may not arrive; '' if there is no sign of a cause."""
    cause = first_cause([RULES[code] for code in _OF_TOPICS], Facts('silence', around))
    return f'{cause.text}{see(cause.section)}' if cause else ''


def explain_silence(around: Surroundings) -> str:
    """Return why nothing has been received; '' if something has."""
    return why_not_received(around) or (
        '' if around.has_data or not around.topics else explain(Facts('silence', around))[0])
