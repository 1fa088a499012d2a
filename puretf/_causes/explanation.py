"""What follows tf2's words in the text of an error: facts, causes with remedies, where to read."""

from collections.abc import Collection, Sequence
import re

from puretf._causes.facts import (
    CLEARED,
    Edge,
    Facts,
    FUTURE,
    Look,
    MISSING,
    ONE_TIME,
    OTHER_CLOCK,
    PAST,
    RECENT,
    SILENCE,
    Surroundings,
    UNCONNECTED,
)
from puretf._causes.lookups import arrives, data_offset, RULES
from puretf._causes.rules import Cause, causes
from puretf._text.names import comma_list, MAX_TOPICS, quoted, see, shortened
from puretf._text.similar_names import suggest_names
from puretf._text.times import exact_time, SECOND

#: The largest number of causes in a text, and of words with two of them.
_MOST_CAUSES, _MOST_WORDS = 2, 56
#: The sections that follow if no cause is known.
_SECTIONS = {MISSING: 'A frame does not exist', SILENCE: 'A frame does not exist',
             UNCONNECTED: 'Two unconnected trees', PAST: 'Extrapolation into the past',
             FUTURE: 'Extrapolation into the future', ONE_TIME: 'Only one time is in the buffer',
             CLEARED: 'A jump back in time'}


def explain(facts: Facts) -> tuple[str, tuple[str, ...]]:
    """Return the text, and the codes of the causes that it names."""
    found = causes(RULES.values(), facts, facts.symptom)[:_MOST_CAUSES]
    known = _known(facts, {cause.code for cause in found})
    if not found:
        return known + _without_cause(facts), ()
    texts = [known, *map(cause_text, found)]
    if len(' '.join(texts).split()) > _MOST_WORDS:
        del found[1:], texts[2:]
    return ' '.join(texts).strip() + see(found[0].section), tuple(each.code for each in found)


def cause_text(cause: Cause) -> str:
    """Return the evidence and the remedy as sentences."""
    return f'{cause.evidence}.{f" {cause.remedy}" if cause.remedy else ""}'


def text_of(code: str, facts: Facts) -> str:
    """Return the text of one cause; '' if it is none."""
    return ' '.join(map(cause_text, causes([RULES[code]], facts, facts.symptom)))


#: Their evidence says when the data arrive, or how far they are from the clock.
_OF_ARRIVALS = {'other_clock', 'use_sim_time_differs', 'time_goes_back', 'one_shot', 'zero_stamp',
                'nanosec', 'not_a_number', 'unnormalized', 'loop', 'empty_name'}


def _known(facts: Facts, codes: Collection[str]) -> str:
    """Return the facts in one or two sentences."""
    around = facts.around
    if facts.symptom in (MISSING, SILENCE):
        known = tuple(facts.buffer.names)
        names = ('' if facts.symptom == SILENCE else 'The buffer is empty.'
                 if not (known or around.topics) else suggest_names(facts.names[0], known))
        nodes = sorted({each.node for each in around.publishers or ()})
        why = ('' if around.has_data or not around.topics else
               'The listener has just started; discovery can take some seconds.'
               if around.is_new else
               f'Nothing has arrived yet from {comma_list(nodes, MAX_TOPICS, shortened)}.'
               if nodes else '')
        return ' '.join(filter(None, (names, why)))
    if facts.symptom == UNCONNECTED:
        (target, source), (target_root, source_root) = map(quoted, facts.names), map(
            quoted, facts.roots)
        return (f'{target} is in the tree with root {target_root}, {source} in the tree with root '
                f'{source_root}.')
    edge = facts.edge
    if edge is None:
        return (f'No transform of {quoted(facts.names[0])} has been received since the buffer was '
                'cleared, or mended after an interrupted insertion.')
    span = (f'are from {exact_time(edge.oldest)} to {exact_time(edge.latest)}'
            if edge.oldest != edge.latest else f'are all at {exact_time(edge.latest)}')
    where = (f' and end {exact_time(facts.time - edge.latest)} s before that time'
             if facts.time > edge.latest else
             f' and begin {exact_time(edge.oldest - facts.time)} s after that time'
             if facts.time < edge.oldest else '')
    arrivals = _arrivals(facts, edge) if around.topics and _OF_ARRIVALS.isdisjoint(codes) else ''
    return (f'The data of edge {quoted(edge.parent)} -> {quoted(edge.child)} {span}{where}.'
            f'{arrivals}')


def _arrivals(facts: Facts, edge: Edge) -> str:
    """Say when and from whom the last transform has come, if it is not the usual way."""
    around = facts.around
    if not arrives(facts):
        node, topic = around.node_of(edge.authority), around.topics[-1]
        nodes = comma_list(around.nodes(topic), MAX_TOPICS, shortened)
        who = (f' from {shortened(node)}' if node else f'; on {topic} now: {nodes}' if nodes else
               f'; nothing publishes on {topic} now')
        return f' The last one arrived {edge.silence / SECOND:.1f} s ago{who}.'
    if edge.stalled > RECENT:
        return f' Its stamp has not advanced for {edge.stalled / SECOND:.1f} s.'
    offset = data_offset(facts)
    return '' if abs(offset) <= RECENT else (
        f' Data arrive {abs(offset) / SECOND:.1f} s {"ahead of" if offset > 0 else "behind"} the '
        'clock of this node.')


def _without_cause(facts: Facts) -> str:
    """Say more of an early time, and where to read on."""
    now, edge, text = facts.around.now, facts.edge, ''
    if facts.symptom == PAST and edge:
        if now and now - facts.time > OTHER_CLOCK:
            text = (f' That time is {(now - facts.time) / SECOND:.1f} s behind the clock of this '
                    'node.')
        elif not edge.has_dropped:
            text = ' No earlier transform was received.'
    has_one_time = edge and edge.oldest == edge.latest and not edge.has_dropped
    text += see(_SECTIONS[ONE_TIME if has_one_time else facts.symptom])
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
    nodes = comma_list(around.nodes(topic), MAX_TOPICS, shortened)
    return nodes and f'. Publishers on {topic}: {nodes}.'


def old_data_end(look: Look, authority: str) -> str:
    return f'{publisher_end(look, authority, False) or "."}{see("TF_OLD_DATA")}'


def clock_publishers(nodes: Sequence[str]) -> str:
    """Name the publishers of /clock; several make the time jump."""
    if len(nodes) == 1:
        return f' Publisher of /clock: {shortened(nodes[0])}.'
    text = text_of('two_clocks', Facts(CLEARED, Surroundings(
        clock_nodes=nodes, is_simulated=True)))
    return text and f' {text}'


# Without a lookup


#: Why transforms may not arrive on the topics of a listener.
_OF_TOPICS = ('wrong_type', 'volatile_listener', 'static_not_latched', 'incompatible_qos',
              'other_namespace')


def why_not_received(around: Surroundings) -> str:
    """Return why transforms may not arrive; '' if there is no sign of a cause."""
    rules = [RULES[code] for code in _OF_TOPICS]
    found = causes(rules, Facts(SILENCE, around), SILENCE)[:_MOST_CAUSES]
    return ' '.join(map(cause_text, found)) + see(found[0].section) if found else ''


def explain_silence(around: Surroundings) -> str:
    """Return why nothing has been received; '' if something has."""
    return why_not_received(around) or (
        '' if around.has_data or not around.topics else explain(Facts(SILENCE, around))[0])
