"""Errors and `tf_doctor` name the cause of a situation where a rule is satisfied, and no other."""

import re

from environment import ROOT
import pytest
from situations import FAULTY, HEALTHY, THOUGHT_OF, UNLUCKY

from puretf._causes.facts import CLEARED, Edge, Facts, Frames, MISSING, PAST, Surroundings
from puretf._causes.lookups import RULES
from puretf._causes.rules import causes
from puretf_tools.doctor import examine
from puretf_tools.doctor.checks import CHECKS, INFO

CASES = [pytest.param(situation.world, lookup, id=f'{situation.name}: {i}')
         for situation in FAULTY + HEALTHY + THOUGHT_OF + UNLUCKY
         for i, lookup in enumerate(situation.lookups)]


@pytest.mark.parametrize(('world', 'lookup'), CASES)
def test_an_error_has_its_cause(world, lookup):
    """It has at most 60 words after tf2's, and no other cause."""
    error = world.error_of(lookup)
    if lookup.causes is None:
        assert error is None
        return
    assert error is not None
    text = str(error)
    assert error.causes == (*lookup.causes,), text
    assert all(word in text for word in lookup.words), text
    assert not any(word in text for word in lookup.not_words), text
    assert 'More: tf_doctor --explain ' in text
    words = re.split(r'does not exist\. |unconnected trees\. |\]\. ', text)[1].split()
    assert len(words) <= 60, text


def findings(situation):
    """Return by code what `tf_doctor` finds."""
    return {each.code: each for each in examine(situation.world.observation()).findings}


@pytest.mark.parametrize('situation', FAULTY, ids=lambda each: each.name)
def test_the_doctor_finds_the_cause(situation):
    """It finds the cause that errors name, or what the situation says, and nothing else."""
    found = findings(situation)
    known = {code for lookup in situation.lookups for code in lookup.causes or ()}
    assert found.keys() == (known & CHECKS.keys() if situation.finds is None else {
        *situation.finds})


@pytest.mark.parametrize('situation', HEALTHY, ids=lambda each: each.name)
def test_the_doctor_blames_nobody_in_a_healthy_situation(situation):
    """It may say facts."""
    assert [each for each in findings(situation).values() if each.severity != INFO] == []


def test_the_rules_that_the_doctor_has():
    """It has all but those which only the process of a lookup can know, in the same sections."""
    on_wire = {code: rule.section for code, rule in RULES.items() if rule.is_on_wire}
    assert on_wire == {code: CHECKS[code].section for code in RULES.keys() & CHECKS.keys()}


S = 10**9
EDGE = Edge('map', 'base', 9, S, 9 * S, 10 * S, True, '', 0, 0, 0, 0, '', False)
#: Rules for what a world does not have.
DIRECT = [
    (Facts(PAST, Surroundings(), Frames(takes_ns=True), time=5, edge=EDGE), 'time_in_seconds'),
    (Facts(PAST, Surroundings(), time=5, edge=EDGE, is_duration=True), 'time_is_duration'),
    (Facts(PAST, Surroundings(), time=5, edge=EDGE._replace(is_full=True)), 'too_many_samples'),
    (Facts(PAST, Surroundings(), time=5, edge=EDGE._replace(nanosec=2**32 - 1)), 'nanosec'),
    (Facts(CLEARED, Surroundings(topics=['/tf'], is_simulated=True, clock_nodes=['/sim'])),
     'cleared'),
    (Facts(MISSING, Surroundings(), Frames(missing_part=('A part is missing', 'Read a.'))),
     'missing_part')]


@pytest.mark.parametrize(('facts', 'code'), DIRECT)
def test_facts_have_a_cause(facts, code):
    assert [each.code for each in causes(RULES.values(), facts, facts.symptom)][:1] == [code]


def test_each_rule_is_reached():
    """By a situation of these."""
    reached = {code for situation in FAULTY + THOUGHT_OF for lookup in situation.lookups
               for code in lookup.causes or ()}
    assert reached | {code for _, code in DIRECT} == RULES.keys()


def test_only_remedies_tell_what_to_do():
    """No evidence of a rule is an imperative, as its remedy is."""
    verbs = {rule.remedy.partition(' ')[0] for rule in RULES.values()} - {'', 'If', 'To', 'All'}
    source = (ROOT / 'puretf' / '_causes' / 'lookups.py').read_text()
    for evidence in re.findall(r'Evidence\(\s*f?[\'"]([^\'"]+)', source):
        assert evidence.split(' ')[0] not in verbs
