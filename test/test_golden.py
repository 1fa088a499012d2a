"""What the real tf2 answers."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from dummy_arm.tf import BufferCore, exceptions

CASES = json.loads((Path(__file__).parent / 'data' / 'tf2_answers.json').read_text())


def buffer_of(case):
    """Insert what the case inserted."""
    buffer = BufferCore(case['cache_time_s'] * 1_000_000_000)
    for op in case['ops']:
        buffer.insert(op['stamp_ns'], op['parent'], op['child'], (*op['xyz'], *op['xyzw']),
                      is_static=op['static'])
    return buffer


def ask(buffer, query):
    """Ask whether there is an answer, then for it: (can, Transform or exception)."""
    if query['kind'] == 'full':
        names = ['target', 'target_ns', 'source', 'source_ns', 'fixed']
        can, lookup = buffer.can_transform_full, buffer.lookup_transform_full
    else:
        names = ['target', 'source', 'time_ns']
        can, lookup = buffer.can_transform, buffer.lookup_transform
    arguments = [query[name] for name in names]
    try:
        return can(*arguments), lookup(*arguments)
    except exceptions.TransformException as error:
        return can(*arguments), error


def test_all_cases_are_there():
    """None was lost."""
    assert len(CASES) == 66
    assert sum(len(case['queries']) for case in CASES) == 1294


@pytest.mark.parametrize('case', CASES, ids=[case['name'] for case in CASES])
def test_answers_as_tf2(case):
    """Value and stamp, or exception and message."""
    buffer = buffer_of(case)
    for query in case['queries']:
        if query['kind'] == 'frames':
            assert {frame.name: frame.parent for frame in buffer.frames()} == query['parents']
            continue
        can, answer = ask(buffer, query)
        assert can == query['can'], query
        if 'error' in query:
            assert type(answer) is getattr(exceptions, query['error']), query
            assert str(answer).startswith(query['message'])
            continue
        assert answer.stamp == query['stamp_ns'], query
        assert (answer.frame_id, answer.child_frame_id) == (query['target'], query['source'])
        assert answer.translation == pytest.approx(query['xyz'], abs=1e-9, rel=0, nan_ok=True)
        sign = math.copysign(1.0, np.dot(answer.rotation, query['xyzw']))
        assert [sign * number for number in answer.rotation] == pytest.approx(
            query['xyzw'], abs=1e-9, rel=0)


@pytest.mark.parametrize('case', CASES, ids=[case['name'] for case in CASES])
def test_many_at_once_are_the_same_answers(case):
    """All times that were asked for, of every pair of frames that was asked for."""
    buffer = buffer_of(case)
    lookups = [query for query in case['queries'] if query['kind'] == 'lookup']
    times = [query['time_ns'] for query in lookups]
    for target, source in {(query['target'], query['source']) for query in lookups}:
        translations, rotations, known = buffer.lookup_transforms(target, source, times)
        for i, time in enumerate(times):
            try:
                one = buffer.lookup_transform(target, source, time)
            except exceptions.TransformException:
                assert not known[i]
                assert np.isnan([*translations[i], *rotations[i]]).all()
            else:
                assert known[i]
                assert translations[i] == pytest.approx(one.translation, abs=1e-12, nan_ok=True)
                assert rotations[i] == pytest.approx(one.rotation, abs=1e-12)
