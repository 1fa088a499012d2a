"""Comparison with recorded answers of the real tf2."""

import json
import math

from environment import DATA
import numpy as np
import pytest

from puretf import exceptions, TransformBuffer

CASES = json.loads((DATA / 'tf2_answers.json').read_text())


def buffer_of(case):
    """Return a buffer with the transforms of a case."""
    buffer = TransformBuffer(case['cache_time_s'] * 1_000_000_000)
    for op in case['ops']:
        buffer.insert(op['stamp_ns'], op['parent'], op['child'], (*op['xyz'], *op['xyzw']),
                      is_static=op['static'])
    return buffer


def run_query(buffer, query):
    """Return the answer of can_transform, and the transform or the exception of the lookup."""
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


@pytest.mark.parametrize('case', CASES, ids=[case['name'] for case in CASES])
def test_answers_as_tf2(case):
    """A lookup returns tf2's value and stamp, or raises tf2's exception with its message."""
    buffer = buffer_of(case)
    for query in case['queries']:
        if query['kind'] == 'frames':
            assert {frame.name: frame.parent for frame in buffer.frames()} == query['parents']
            continue
        can, answer = run_query(buffer, query)
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
