"""What feeds transforms, and what other topics have: which of it is a fault."""

import pytest
from recorded import MS, observed, T, tf

from puretf._causes.facts import Facts, Frames, Heard, Surroundings
from puretf._causes.lookups import RULES
from puretf_tools.doctor import examine
from puretf_tools.inspection.feeds import Sender

#: 50 Hz for 2 s.
ROBOT = [tf(i, i, 'map odom') for i in range(0, 2000, 20)]


def codes(transforms=ROBOT, messages=(), **kwargs):
    """Return the codes of what is found."""
    return {each.code for each in examine(observed(transforms, messages, **kwargs)).findings}


def sender(node, *names, first=0, last=1000, ahead=0):
    """Return a sender with two messages; times in ms after `T`."""
    result = Sender(node)
    for time in first, last:
        result.add(T + time * MS, T + (time + ahead) * MS, names)
    return result


# Half a namespace


def other(topic, *edges):
    """Return another topic, with edges 'parent child'."""
    return Heard(topic, topic, [f'/of{topic}'],
                 {child: parent for parent, child in map(str.split, edges)})


def halves(here, base, others):
    """Return the parent, the child and the topic of what continues a tree."""
    facts = Facts('none', Surroundings(topics=[f'{base}_static', base], listen=lambda: others),
                  Frames(newest={child: parent for parent, child in map(str.split, here)}))
    return [(*each.frames, *each.topics) for each in RULES['half_namespace'].find(facts)]


WHOLE = 'map odom', 'odom base'


@pytest.mark.parametrize(('here', 'base', 'others', 'expected'), [
    (['map odom'], '/tf', [other('/robot1/tf', 'odom base')], [('odom', 'base', '/robot1/tf')]),
    (['odom base'], '/robot1/tf', [other('/tf', 'map odom')], [('map', 'odom', '/tf')]),
    (['map odom', 'odom base'], '/tf', [other('/robot1/tf_static', 'base laser')],
     [('base', 'laser', '/robot1/tf_static')]),
    (['base laser', 'map odom'], '/tf', [other('/robot1/tf', 'odom base')],
     [('odom', 'base', '/robot1/tf')]),
    (['map odom'], '/robot1/tf', [other('/Robot_1/tf', 'odom base')],
     [('odom', 'base', '/Robot_1/tf')]),
    (['odom base'], '/tf', [other('/model/car/pose', 'map odom')],
     [('map', 'odom', '/model/car/pose')]),
    # The nearest one is first, not the first of the alphabet.
    (['map odom', 'map dock'], '/fleet/tf',
     [other('/fleet/a/b/tf', 'dock x'), other('/fleet/r/tf', 'odom y')],
     [('odom', 'y', '/fleet/r/tf'), ('dock', 'x', '/fleet/a/b/tf')])])
def test_halves_of_a_tree(here, base, others, expected):
    """An edge at the frame that connects them is found, from both sides."""
    assert halves(here, base, others) == expected


@pytest.mark.parametrize(('here', 'base', 'others'), [
    (WHOLE, '/robot1/tf', [other('/robot2/tf', *WHOLE)]),
    (WHOLE, '/tf', [other('/robot1/tf', *WHOLE)]),  # a relay
    (WHOLE, '/tf', [other('/robot1/tf', 'odom base')]),  # a robot without a map
    (['odom base'], '/tf', [other('/robot1/tf', *WHOLE)]),
    (['map r1/odom', 'r1/odom r1/base'], '/robot1/tf',
     [other('/tf', 'map r2/odom', 'r2/odom r2/base')]),  # a common root
    (['base arm'], '/robot1/tf', [other('/robot2/tf', 'odom base', 'base gripper')]),
    (WHOLE, '/tf', [other('/robot1/tf', 'world lamp')]),
    ([], '/tf', [other('/robot1/tf', *WHOLE)])])
def test_whole_trees(here, base, others):
    """Other robots are no halves, whatever their frames are called."""
    assert halves(here, base, others) == []


def test_robots_that_share_a_map():
    """Each has it as its root, whether one looks from outside or from one of them."""
    robots = [other(f'/r{i}/tf', f'map r{i}/odom') for i in (1, 2, 3)]
    assert halves(['earth map'], '/tf', robots) == []
    assert halves(['map r1/odom'], '/r1/tf', [other('/tf', 'earth map'), *robots[1:]]) == []
    assert len(halves(['earth map'], '/tf', robots[:1])) == 1


# Joint states


def test_joint_states_of_another_robot():
    """A topic in a namespace with transforms of its own is not judged."""
    senders = sender('/a', 'turn'), sender('/b', 'turn')
    topics = {'joint_senders': {'/r2/joint_states': senders}}
    assert codes(**topics) == {'two_joint_publishers'}
    assert codes(**topics, tf_topics=['/tf', '/r2/tf']) == set()


# The clock


@pytest.mark.parametrize(('lead', 'ahead', 'others', 'found', 'remedy'), [
    (lambda i: 1000, {'/robot': -MS}, True, 'info future', 'transform_tolerance'),
    (lambda i: 1000, {'/robot': -MS}, False, 'warning future', 'clock of its computer is right.'),
    (lambda i: 30 * i, {'/robot': -MS}, True, 'warning future', 'clock of its computer is right.'),
    (lambda i: 1000, {'/robot': 990 * MS}, True, 'warning future',
     'that of the sender is 0.99 s ahead, by the dates of its messages.'),
    (lambda i: 1000, {'/robot': -990 * MS}, True, 'warning future', ' 0.99 s behind, by the'),
    (lambda i: 1000, {}, True, 'warning future', 'Compare the clocks of the computers'),
    (lambda i: 1000, None, True, 'info future', 'else compare the clocks'),  # in a bag
    (lambda i: 6000, None, True, 'warning future', 'Compare the clocks of the computers'),
    (lambda i: 37_000, {}, True, 'error other_clock', 'Look at the clock')])
def test_stamps_of_the_future(lead, ahead, others, found, remedy):
    """They are right if the lead is constant, and the clock of the sender is right."""
    content = [tf(i * 20, i * 20 + lead(i), 'map odom') for i in range(200)]
    if others:
        content += [tf(i * 20, i * 20, 'odom base') for i in range(200)]
    (finding,) = examine(observed(
        content, [], ahead=ahead or {}, has_record_times=ahead is None)).findings
    assert (f'{finding.severity} {finding.code}', finding.frames) == (found, ('odom',))
    assert remedy in finding.remedy
    assert ('TAI - UTC' in finding.evidence) == (lead(0) == 37_000)


@pytest.mark.parametrize(('shift', 'code'), [(-5000, 'late'), (5000, 'future')])
@pytest.mark.parametrize(('is_bag', 'severity'), [(True, 'info'), (False, 'warning')])
def test_the_clock_of_the_arrivals(shift, code, is_bag, severity):
    """If all stamps are as far from it, those of the nodes are not blamed."""
    content = [tf(i * 20, i * 20 + shift, 'map odom') for i in range(200)]
    for other, is_blamed in (0, False), (1000, True):
        messages = [(i * 20 + 10, i * 20 + shift + other) for i in range(200)]
        (finding,) = examine(observed(
            content, messages, 'map', has_record_times=is_bag)).findings
        assert (finding.code, finding.severity) == (code, 'warning' if is_blamed else severity)
        assert ('Compare the clock of the computer' in finding.remedy) is not is_blamed


def test_a_simulation_that_is_started_again():
    """One node publishes /clock after the other; the buffers were cleared, so nothing is old."""
    stamps = [40, 41, 2, 3, 4]
    content = [tf(i * 1000, stamp * 1000, 'map odom') for i, stamp in enumerate(stamps)]
    clocks = [sender('/old', last=1500), sender('/new', first=1900, last=4000)]
    for clears, is_refused in ([], True), ([T + 1800 * MS], False):
        (finding,) = examine(
            observed(content, [], clocks=clocks, clears=clears), ignore=['gap', 'future']).findings
        assert finding.code == 'time_goes_back'
        assert ('refuses' in finding.evidence) is is_refused


CLOCK = {'clocks': [sender('/gazebo')], 'nodes': {'/robot': '/driver'}}


@pytest.mark.parametrize(('answers', 'more', 'expected'), [
    ({'/driver': False, '/nav': True}, {}, 'info'),  # its stamps are those of the clock
    ({'/driver': False, '/nav': True}, {'tf_listeners': ['/driver', '/nav']}, 'warning'),
    ({'/driver': False, '/nav': True}, {'clocks': [sender('/gazebo', ahead=-10**9)]}, 'error'),
    ({'/driver': False, '/nav': False}, {}, None),
    ({'/driver': True, '/nav': True}, {}, None),
    ({'/driver': True, '/silent': False}, {}, None),
    ({'/driver': False, '/nav': True}, {'clocks': []}, None)])
def test_nodes_that_use_the_clock_and_others(answers, more, expected):
    """It is a fault if a node without the clock sends other stamps, or looks transforms up."""
    report = examine(observed(ROBOT, [], **CLOCK | more, use_sim_time=answers))
    assert [(each.code, each.severity, each.nodes) for each in report.findings] == [
        ('use_sim_time_differs', expected, ('/driver',))] * bool(expected)
    if expected:
        assert report.findings[0].evidence == (
            'use_sim_time is false in /driver, and true in /nav, while /gazebo publishes /clock')
