"""docs/troubleshooting.md: each of its symptoms is provoked, and leads to its section."""

import re

from environment import ROOT
import pytest
from recorded import observed, S, T, tf

from dummy_arm.doctor import examine
from dummy_arm.doctor.checks import CHECKS, SECTIONS
from dummy_arm.tf import TransformBuffer, TransformException
from dummy_arm.tf._core.engine import engine_of
from dummy_arm.tf._core.hints import Publisher, Surroundings

PAGE = (ROOT / 'docs' / 'troubleshooting.md').read_text()
STILL = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
#: By heading: the other cells of the row.
ROWS = {heading: (cause, re.findall('`([a-z_0-9]+)`', codes)) for heading, cause, codes in
        re.findall(r'^\| \[(.*?)\]\(.*?\) \| (.*?) \| (.*?) \|$', PAGE, re.M)}
#: 50 Hz for 20 s.
ROBOT = [tf(i, i, 'odom base') for i in range(0, 20_000, 20)]


def error_of(source='base', time=0, stamps=range(0, 20), **surroundings):
    """Return the text of the error of a lookup."""
    buffer = TransformBuffer(cache_time=10 * S)
    for second in stamps:
        buffer.insert(T + second * S, 'map', 'base', STILL)
    buffer.insert(0, 'world', 'lamp', STILL, is_static=True)
    engine_of(buffer).look = lambda: Surroundings(**surroundings)
    if not stamps:
        buffer.insert(T, 'map', 'base', STILL)
        buffer.clear()
    with pytest.raises(TransformException) as raised:
        buffer.lookup_transform('map', source, T + time * S if time else 0)
    return str(raised.value)


def old_data(logs):
    """Return the warning about a transform that is too old."""
    buffer = TransformBuffer(cache_time=10 * S)
    for stamp in T, T - 20 * S:
        buffer.insert(stamp, 'map', 'base', STILL, '/arm')
    return '\n'.join(record.getMessage() for record in logs)


def report(transforms=(), messages=(), **kwargs):
    """Return the text of the report on transforms and on messages, each (arrival, stamp) in ms."""
    return str(examine(observed([*ROBOT, *transforms], messages, **kwargs)))


TF = 'tf2_msgs/msg/TFMessage'
#: By heading: a function that returns the text, and the words of the symptom in it.
PROVOKED = {
    'Extrapolation into the future': (
        lambda _: error_of(time=20), 'Lookup would require extrapolation into the future'),
    'Extrapolation into the past': (
        lambda _: error_of(time=5), 'Lookup would require extrapolation into the past'),
    'Only one time is in the buffer': (
        lambda _: error_of(time=5, stamps=[1]), 'only time 1700000001.000000 is in the buffer'),
    'A frame does not exist': (lambda _: error_of('bsae'), '"bsae" passed to'),
    'Two unconnected trees': (lambda _: error_of('lamp'), 'two or more unconnected trees'),
    'TF_OLD_DATA': (old_data, 'TF_OLD_DATA ignoring data from the past'),
    'TF_REPEATED_DATA': (
        lambda _: report([tf(20_000, 19_980, 'odom base', x=1.0)]), 'warning same_stamp'),
    'The queue of a message filter is full': (
        lambda _: report(messages=[(9000 + i, 30_000) for i in range(99)]), 'error message_never'),
    'Messages are earlier than all data in the cache': (
        lambda _: report(messages=[(15_000 + i, i) for i in range(99)]), 'error message_too_old'),
    'use_sim_time and the wall clock': (
        lambda _: error_of(time=-T // S + 5), 'different clocks'),
    'The QoS of /tf_static': (
        lambda _: error_of('lidar', topics=('/tf_static', '/tf'), publishers=[
            Publisher('/lidar', '/tf_static', TF, 'ab', 'transient local')]), 'not transient local'),
    'No static transforms from a bag': (
        lambda _: report(missing_part='b_1.mcap is without the first part'), 'missing_part'),
    'A frame jumps or flickers': (
        lambda _: report([tf(20_000, 20_000, 'odom base', x=9.0)]), 'warning jump'),
    'A jump back in time': (
        lambda _: error_of(time=5, stamps=[]), 'since the buffer was cleared'),
    'A leading slash, or a namespace': (
        lambda _: error_of('lidar', topics=('/tf_static', '/tf'), other_topics=['/robot1/tf']),
        '/robot1/tf'),
}


def test_the_table_has_the_fifteen_symptoms():
    """In the order of their sections; each has its test here, and its codes exist."""
    headings = re.findall('^## (.*)$', PAGE, re.M)
    assert [*ROWS, 'Other faults'] == headings
    assert len(ROWS) == 15
    assert ROWS.keys() == PROVOKED.keys()
    for heading, (_, codes) in ROWS.items():
        assert codes
        assert {*codes} <= CHECKS.keys()
        assert {*codes} >= {*SECTIONS.get(heading, ())}
        section = PAGE.split(f'\n## {heading}\n')[1].split('\n## ')[0]
        assert all(f'**{part}.**' in section for part in ('Cause', 'See it', 'Change'))
    rest = CHECKS.keys() - {code for codes in SECTIONS.values() for code in codes}
    others = PAGE.split('\n## Other faults\n')[1]
    assert rest == {*re.findall('`([a-z_0-9]+)`', others)}


@pytest.mark.parametrize('heading', PROVOKED)
def test_a_symptom_leads_to_its_section(logs, heading):
    """The error or the finding has the words of the symptom, and names the section."""
    provoke, words = PROVOKED[heading]
    text = ' '.join(provoke(logs).split())
    assert words in text
    assert f'See troubleshooting.md: {heading}.' in text
