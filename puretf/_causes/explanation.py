"""What follows tf2's words in the text of an error: facts, a cause and its remedy, a section."""

from collections.abc import Sequence
from dataclasses import replace
import re

from puretf._causes.clocks import apart
from puretf._causes.facts import Facts, listed, Look, RECENT, Surroundings, UNKNOWN
from puretf._causes.lookups import RULES
from puretf._causes.rules import first_cause
from puretf._text.names import quoted, see, shortened
from puretf._text.similar_names import is_slip, suggest_names
from puretf._text.times import exact_time, SECOND

#: The sections that follow if no cause is known; of other symptoms, that of a missing frame.
_SECTIONS = {'unconnected': 'two_trees', 'past': 'past',
             'future': 'future', 'cleared': 'jump_back'}


def explain(facts: Facts) -> tuple[str, tuple[str, ...]]:
    """Return the text, and the code of the cause that it names."""
    # Without a listener, no rule could blame anything else.
    if facts.symptom == 'missing' and facts.around.topics and any(
            is_slip(facts.names[0], name) for name in facts.buffer.names):
        facts = replace(facts, symptom='typo')
    cause = first_cause(RULES.values(), facts)
    # Any other cause says itself when the data arrive, if that matters.
    arrivals = _arrivals(facts) if cause is None or cause.code == 'too_soon' else ''
    end = f' {cause.text}{see(cause.section)}' if cause else _without_cause(facts)
    return f'{_known(facts)}{arrivals}{end}'.lstrip(), (cause.code,) if cause else ()


def _known(facts: Facts) -> str:
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
        nodes = sorted({each.node.replace(UNKNOWN, 'a publisher whose node is not known')
                        for each in around.publishers})
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
        return (f' The last one arrived {edge.silence / SECOND:.1f} s ago'
                f'{publisher_end(lambda: around, edge.authority, False)}')
    if edge.stalled > RECENT:
        return f' Its stamp has not advanced for {edge.stalled / SECOND:.1f} s.'
    return '' if abs(facts.offset) <= RECENT else (
        f' Data arrive {apart(facts.offset, edge.latest)} the clock of this node.')


def _without_cause(facts: Facts) -> str:
    """Say more of an early time, and where to read on."""
    edge, text, section = facts.edge, '', _SECTIONS.get(facts.symptom, 'missing_frame')
    if edge.child and not edge.has_dropped:
        if facts.symptom == 'past':
            text = ' No earlier transform was received.'
        if edge.oldest == edge.latest:
            section = 'one_time'
    if facts.symptom == 'cleared' and facts.around.is_simulated:
        text = clock_end(lambda: facts.around)
    text += see(section)
    if facts.around.topics and len(facts.names) == 2 and all(
            re.fullmatch(r'[\w./-]+', name) for name in facts.names):
        text += f'; tf_doctor {" ".join(facts.names)}'
    return text


# The ends of log lines, which have no period yet


def publisher_end(look: Look, authority: str, is_static: bool) -> str:
    """Name the publisher of a transform, or all of its topic; '' if there is no listener."""
    around = look()
    if node := around.node_of(authority):
        return f'. Publisher: {shortened(node)}.'
    topic = around.topics[0 if is_static else -1] if around.topics else ''
    return topic and f'. Publishers on {topic}: {listed(around.nodes(topic)) or "none"}.'


def old_data_end(look: Look, authority: str) -> str:
    return f'{publisher_end(look, authority, False) or "."}{see("old_data")}'


def clock_end(look: Look) -> str:
    nodes = listed(look().clock_nodes)
    return nodes and f' Publishers of /clock: {nodes}.'


# Without a lookup


#: Why transforms may not arrive on the topics of a listener.
_OF_TOPICS = ('wrong_type', 'volatile_listener', 'static_not_latched', 'incompatible_qos',
              'other_namespace')


def why_not_received(around: Surroundings, codes: Sequence[str] = _OF_TOPICS) -> str:
    """Return why transforms may not arrive; '' if there is no sign of one of the causes."""
    cause = first_cause([RULES[code] for code in codes], Facts('silence', around))
    return f'{cause.text}{see(cause.section)}' if cause else ''


def explain_silence(around: Surroundings) -> str:
    """Return why nothing has been received; '' if something has."""
    return why_not_received(around) or (
        '' if around.has_data or not around.topics else explain(Facts('silence', around))[0])
