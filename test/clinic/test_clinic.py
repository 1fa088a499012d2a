"""Errors and `tf_doctor` name the cause of a situation where a rule is satisfied, and no other."""

import re

from environment import ROOT
import pytest
from situations import ELSEWHERE, FAULTY, HEALTHY, REMEDIES, THOUGHT_OF, UNLUCKY

from puretf._causes.facts import Edge, Facts, Frames, Surroundings
from puretf._causes.lookups import RULES
from puretf._causes.rules import first_cause
from puretf_tools.doctor import examine
from puretf_tools.doctor.checks import CHECKS, INFO

ALL = FAULTY + HEALTHY + THOUGHT_OF + UNLUCKY
CASES = [pytest.param(situation.world, lookup, id=f'{situation.name}: {i}')
         for situation in ALL
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
    section = RULES[lookup.causes[0]].section if lookup.causes else ''
    assert f'More: tf_doctor --explain {section}' in text
    words = re.split(r'does not exist\. |unconnected trees\. |\]\. ', text)[1].split()
    assert len(words) <= 60, text


def causes_of(situation):
    """Return the codes in the errors of the lookups."""
    return {code for lookup in situation.lookups for code in lookup.causes or ()}


def finds(situation):
    """Return the codes of what `tf_doctor` should find."""
    return causes_of(situation) & CHECKS.keys() if situation.finds is None else {*situation.finds}


def findings(situation):
    """Return by code what `tf_doctor` finds."""
    return {each.code: each for each in examine(situation.world.observation()).findings}


@pytest.mark.parametrize('situation', FAULTY, ids=lambda each: each.name)
def test_the_doctor_finds_the_cause(situation):
    """It finds the cause that errors name, or what the situation says, and nothing else."""
    report = examine(situation.world.observation())
    assert {each.code for each in report.findings} == finds(situation)
    assert all(text in str(report) for text in situation.report), str(report)


@pytest.mark.parametrize(('before', 'situation'), [
    pytest.param(each, healed, id=healed.name) for each in FAULTY for healed in each.healed()])
def test_after_the_remedy(before, situation):
    """All is well: lookups have no error, and `tf_doctor` has nothing but facts."""
    assert [*filter(None, map(situation.world.error_of, situation.lookups))] == []
    found = findings(situation)
    assert found.keys().isdisjoint(finds(before))
    assert [each for each in found.values() if each.severity != INFO] == []


@pytest.mark.parametrize('situation', HEALTHY, ids=lambda each: each.name)
def test_the_doctor_blames_nobody_in_a_healthy_situation(situation):
    """It may say facts."""
    assert [each for each in findings(situation).values() if each.severity != INFO] == []


def test_the_rules_that_the_doctor_has():
    """It has all but those which only the process of a lookup can know, in the same sections."""
    on_wire = {code: rule.section for code, rule in RULES.items() if rule.is_on_wire}
    assert on_wire == {code: CHECKS[code].section for code in RULES.keys() & CHECKS.keys()}


S = 10**9
EDGE = Edge('map', 'base', 9, S, 9 * S, 10 * S, True)
#: Rules for what a world does not have.
DIRECT = [
    (Facts('past', Surroundings(), Frames(takes_ns=True), time=5, edge=EDGE), 'time_in_seconds'),
    (Facts('future', Surroundings(), Frames(takes_ns=True), time=S * S,
           edge=EDGE._replace(oldest=S - 1, latest=S)), 'stamps_in_seconds'),
    (Facts('past', Surroundings(), time=5, edge=EDGE, is_duration=True), 'time_is_duration'),
    (Facts('past', Surroundings(), time=5, edge=EDGE._replace(is_full=True)), 'cache_too_short'),
    (Facts('missing', Surroundings(), Frames(missing_part='A part is missing: read a.')),
     'missing_part')]


@pytest.mark.parametrize(('facts', 'code'), DIRECT)
def test_facts_have_a_cause(facts, code):
    cause = first_cause(RULES.values(), facts)
    assert cause is not None
    assert cause.code == code


def test_each_rule_is_reached():
    """By a situation of these."""
    reached = {code for each in FAULTY + THOUGHT_OF for code in causes_of(each)}
    assert reached | {code for _, code in DIRECT} == RULES.keys()


def test_each_row_has_a_test():
    """The names of situations begin with the rows of the logs, which have 42 and 46."""
    here = {row for each in ALL for rows in re.findall(r'^(?:[12][.]\d+,? )+', each.name)
            for row in rows.replace(',', '').split()}
    rows = {f'{log}.{i + 1}' for log, count in ((1, 42), (2, 46)) for i in range(count)}
    assert here | ELSEWHERE.keys() == rows
    assert here.isdisjoint(ELSEWHERE)


def test_the_tests_that_are_named_exist():
    """Each is a function in its file."""
    tests = [each.split('::') for each in (*ELSEWHERE.values(), *REMEDIES.values())]
    assert [test for file, test in tests
            if f'\ndef {test}(' not in (ROOT / 'test' / file).read_text()] == []


def test_each_remedy_is_executed():
    """By a situation, or by another test."""
    executed = [{*REMEDIES}, {*REMEDIES}]
    for each in FAULTY:
        if each.after:
            executed[0] |= causes_of(each)
            executed[1] |= finds(each)
    assert [code for rules, codes in zip((RULES, CHECKS), executed) for code in rules
            if rules[code].remedy and code not in codes] == []
