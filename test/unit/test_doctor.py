"""The doctor, for bags: each fault is found, with its evidence, and nothing else is."""

from contextlib import closing
from decimal import Decimal
from functools import partial
from itertools import cycle
import json
import pickle
import re
import sqlite3
import tracemalloc
import warnings

import pytest

from puretf import bag, TransformBuffer
from puretf_tools.commands.tf_doctor import main
from puretf_tools.doctor import ERROR, examine, examine_bag
from puretf_tools.doctor.checks import CHECKS
from puretf_tools.robot import observed
from puretf_tools.robot.observed import RobotsInBag

bags = pytest.importorskip('bags')
Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime = (
    getattr(pytest.importorskip('rosbags.interfaces'), name) for name in (
        'Qos', 'QosDurability', 'QosHistory', 'QosLiveliness', 'QosReliability', 'QosTime'))
S, MS = bags.S, 10**6
T = 1_700_000_000 * S
KINDS = 'mcap', 'db3', 'bag'
POINT = 'geometry_msgs/msg/PointStamped'
#: A message of another type on /tf.
WRONG = '/tf', T, b'\0\1\0\0', 'geometry_msgs/msg/TransformStamped'


def pose(x, z=0.0):
    """Return a pose at x (m), rotated about z by an angle whose half has the sine `z`."""
    return x, 0.0, 0.0, 0.0, 0.0, z, (1.0 - z * z) ** 0.5


def at(index, hertz=50):
    """Return the stamp of the transform with an index (ns)."""
    return T + index * S // hertz


def tf(index, *edges, stamp=None, delay=MS, publisher='/robot', topic='/tf', x=None):
    """Return a message of a bag with transforms, each 'parent child'."""
    time = at(index)
    stamp = time if stamp is None else stamp
    place = pose(index / 100 if x is None else x)
    rows = [bags.row(stamp, parent, child, place)
            for parent, child in (edge.split(' ') for edge in edges)]
    return topic, time + delay, rows, bags.TF, publisher


def static(*edges, time=T, x=1.0, publisher='/fixed'):
    """Return a message of a bag on /tf_static."""
    rows = [bags.row(time, parent, child, pose(x))
            for parent, child in (edge.split(' ') for edge in edges)]
    return '/tf_static', time, rows, bags.TF, publisher


def robot(count=100, change=lambda i: {}, edges=('odom base_link', 'base_link arm')):
    """Return the messages of a healthy robot; `change` gives other arguments of `tf` for some."""
    return [static('map odom', 'base_link laser'),
            *(tf(i, *edges, **change(i)) for i in range(count))]


def points(topic, *frames):
    """Return messages with headers, which name frames."""
    return [(topic, T + i * MS, (frame, T)) for i, frame in enumerate(frames)]


def scans(topic='/scan', frame='laser', hertz=40, count=80, late=30 * MS, shift=0):
    """Return messages whose stamps are late by some time, or shifted, too (ns)."""
    times = [T + i * S // hertz for i in range(count)]
    return [(topic, time + late, (frame, time + shift)) for time in times]


def in_order(content, kind='mcap'):
    """Sort messages; serialize those with a header, a frame and a stamp, for a kind of bag."""
    return [(*message[:2], bags.point(*message[2], 1 if kind == 'bag' else 2), POINT)
            if isinstance(message[2], tuple) else message
            for message in sorted(content, key=lambda message: message[1])]


def with_pose(messages, index, new):
    """Replace a pose in a message."""
    topic, time, rows, *rest = messages[index]
    messages[index] = topic, time, [rows[0]._replace(pose=new), *rows[1:]], *rest
    return messages


def doctor(capsys, path, *arguments):
    """Run the command for a bag; return the exit code and what the JSON says."""
    code = main(['--bag', str(path), '--json', *arguments])
    return code, json.loads(capsys.readouterr().out)


#: By code: the messages of a bag with this fault only, the frames, and a pattern for the evidence;
#: test/clinic has the others. In the bag of ROS 1, nodes have the names that `tf` gives them.
FAULTS = {
    'two_publishers': (
        [*robot(), *(tf(i, 'odom base_link', publisher='/other', x=i / 100, stamp=at(i) + MS)
                     for i in range(20, 60, 4))], ['base_link'],
        '^/robot and /other both publish base_link: 100 and 10 transforms$'),
    'static_and_dynamic': (
        [*robot(), static('odom base_link')], ['base_link'],
        "^transforms of 'base_link': 100 on /tf, 1 on /tf_static$"),
    'loop': (
        [tf(i, 'c a', 'a b', 'b c') for i in range(100)], ['a', 'b', 'c'],
        '^3 frames in a loop: '),
    'other_clock': (  # that of a simulation is the usual one
        [tf(i, edge, stamp=i * 20 * MS + (S if edge != 'odom arm' else 10**6 * S))
         for i in range(100) for edge in ('map odom', 'odom base_link', 'odom arm')],
        ['arm'], '^all stamps of arm are at least 999997 s after those of odom$'),
    'unnormalized': (
        with_pose(robot(), 7, (0.06, 0.0, 0.0, 0.0, 0.0, 0.0, 1.002)), ['base_link'],
        r'^1 of 100 transforms of base_link with .* whose norm differs from 1 by up to 0\.002$'),
    'message_never': (
        [*robot(100), *(tf(i, 'base_link wheel') for i in range(400)), *scans(count=300)],
        ['laser'], r'^159 of 239 messages on /scan wait in vain for the edge odom -> '
        r'base_link(?: of /robot)?, whose data end at 1700000001\.980000000$'),
    'gap': (
        [message for i, message in enumerate(robot(200)) if not 50 < i <= 80],
        ['base_link', 'arm'],
        r'^no transform of base_link for 0\.62 s after 1700000000\.980000000; 1 of 169 steps from '
        r'stamp to stamp are longer than 3 periods of 0\.02 s$'),
    'jump': (
        [*robot(100, edges=['odom base_link']),
         *(tf(100 + i, 'odom base_link', x=9.0 + i / 100) for i in range(100))], ['base_link'],
        r'^1 of 200 transforms of base_link jump, as by 8\.01 \(m plus rad\) at '
        r'1700000002\.000000000; otherwise, it moves by at most 0\.5 per second$'),
    'time_goes_back': (
        robot(change=lambda i: {'stamp': at(49)} if i == 50 else {'stamp': at(48) - S}
              if i == 51 else {}, edges=['odom base_link'])[:-48], ['base_link'],
        '^1 of 52 transforms of base_link with an earlier stamp'),
}
#: By code: the stamp before the fault, if it has a single time.
TIMES = {'gap': at(49), 'jump': at(100), 'message_never': at(99), 'time_goes_back': at(49)}
#: What is found, too, since it follows from the fault.
ALSO = {'message_never': {'gap'}, 'time_goes_back': {'same_stamp'}}
#: By description: messages that come close to a fault, and where nothing is wrong.
HEALTHY = {
    'a short gap': [message for i, message in enumerate(robot()) if not 50 < i <= 70],
    'some late arrivals': robot(change=lambda i: {'delay': 700 * MS if i > 97 else MS}),
    'the same transform twice': [
        message for i, message in enumerate(robot()) for _ in range(1 + (i == 50))],
    'the opposite quaternion': [*robot(), (
        '/tf_static', T + S, [bags.row(T, 'map', 'odom', (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0))],
        bags.TF, '/fixed')],
    'rounded quaternions': with_pose(
        robot(), 7, (0.06, 0.0, 0.0, 0.0, 0.0, 0.0, 0.9995)),
    'some early scans': [
        *(message for i, message in enumerate(robot()) if not 50 < i <= 58), *scans()],
    'a single stamp 0': [*robot(), ('/scan', T, ('laser', 0)), *scans()],
    'scans of another clock in the root': [*robot(), *scans(frame='map', shift=-T + S)],
    'scans at the end without transforms': [*robot(100), *scans(count=155)],
    'recorded with another clock': [
        tf(i, 'odom base_link', 'base_link arm', delay=1000 * S) for i in range(100)],
    'stamps that begin at 0': [
        ('/tf', T + i * 20 * MS, [bags.row(20 * MS + i * 20 * MS, 'map', 'odom', pose(i / 50))])
        for i in range(100)],
    'a single message': [tf(0, 'map odom')],
    'a frame that begins late': [*robot(), tf(100, 'base_link camera')],
    'a robot that stands and starts': [
        *(tf(i, 'odom base_link', x=0.0 if i < 60 else (i - 60) * 0.5) for i in range(100))],
    'a move within a short gap': [
        tf(i, 'odom base_link', x=0.3 * (i > 60)) for i in range(120) if not 60 < i < 75],
    'a camera that is turned in steps': [
        *(tf(i, 'odom base_link', 'base_link camera', x=i // 10 * 0.1) for i in range(100))],
}
#: By description: messages, and the codes of what is found.
CASES = {
    'jitter': ([tf(i, 'map odom') for i in range(200) if i % 10 not in (3, 4, 5)], {'gap'}),
    'a pause, and then another place': (
        [*robot(), *(tf(200 + i, 'odom base_link', 'base_link arm', x=9.0 + i / 100)
                     for i in range(100))], {'gap'}),
    'a publisher that is started again': (
        [*robot(100), *(tf(i, 'base_link wheel') for i in range(100) if not 30 < i < 45)], set()),
    'a second publisher that sends once': (
        [*robot(), tf(50, 'odom base_link', publisher='/other', stamp=at(50) + MS)],
        {'two_publishers'}),
    'the same name with a slash and without': (
        [*robot(edges=['odom base_link']), *(
            ('/tf', at(i) + 2 * MS, [bags.row(at(i), 'base_link', name, pose(x))], bags.TF,
             '/robot')
            for i in range(100) for name, x in (('arm', 0.0), ('/arm', 1.0)))],
        {'same_stamp', 'leading_slash', 'jump'}),
    'one stamp from another clock': (
        robot(change=lambda i: {'stamp': 5 * S} if i == 99 else {}),
        {'other_clock', 'time_goes_back'}),
    'half of the frames from another clock': (
        [tf(i, edge, stamp=at(i) if edge == 'map odom' else i * 20 * MS + S)
         for i in range(100) for edge in ('map odom', 'odom base_link')], {'other_clock'}),
    'a slow simulation that pauses': (
        [tf(i * 50, edge, stamp=i * S // 10 + S)
         for i in [*range(200), *range(900, 1000)]
         for edge in ('map odom', 'odom arm')[:1 + (i > 900)]], {'gap'}),
    'a frozen stamp in a long recording': (
        # It is more than a minute old, most transforms have it, and scans wait for it in vain.
        [static('base_link laser'), *(tf(i, 'odom base_link') for i in range(0, 5000, 5)),
         *(tf(i, 'map odom', stamp=T, x=i / 100) for i in range(5000)),
         *scans(hertz=1, count=99)], {'frozen_stamp'}),
    'a frozen stamp beside a late frame of its node': (
        [*(tf(i, 'odom base_link', delay=600 * MS) for i in range(150)),
         *(tf(i, 'map odom', stamp=T) for i in range(150))], {'frozen_stamp', 'late'}),
    'two runs of a simulation that begins at 0': (
        [tf(run * 500 + i, 'map odom', stamp=i * 20 * MS) for run in (0, 1) for i in range(400)],
        {'time_goes_back'}),
    'stamps of 0 at the beginning': (
        robot(change=lambda i: {'stamp': 0} if i < 3 else {}), {'zero_stamp'}),
    'two stamps of 0 in one run of a simulation': (
        [tf(i, 'map odom', stamp=max(0, i - 1) * 20 * MS, x=0.0) for i in range(100)],
        {'zero_stamp'}),
    'a gap of a frame that has another parent once': (
        [static('map odom', 'map dock'), *(
            tf(i, 'dock base_link' if i == 150 else 'odom base_link')
            for i in range(200) if not 50 < i <= 80)], {'changing_parent', 'gap'}),
    'a root with another number': ([*robot(), static('map2 lamp')], {'several_trees'}),
    'another robot in a namespace': (
        [*robot(), *((f'/robot2{topic}', *rest) for topic, *rest in [static('odom2 gripper')]),
         *points('/robot2/scan', 'gripper'), *points('/robot2/front/scan', 'gripper')], set()),
    'only another namespace': (
        [static('map odom'), *(tf(i, 'odom base_link', topic='/robot/tf') for i in range(100))],
        {'other_namespace'}),
    'no transforms': ([('/tf', T, [], bags.TF, '/robot')], {'no_transforms'}),
    'two clocks in turn on one frame': (
        [each for i in range(100) for each in (
            tf(i, 'odom base_link'), tf(i, 'odom base_link', stamp=at(i) - 604_800 * S))],
        {'two_publishers', 'other_clock'}),
    'two clocks in turn, 40 s apart': (
        [each for i in range(100) for each in (
            tf(i, 'odom base_link'), tf(i, 'odom base_link', stamp=at(i) - 40 * S))],
        {'two_publishers', 'late'}),
    'a scan with microseconds in nanosec': (
        [*robot(150), *(('/scan', at(i), ('laser', at(i) // S * S + at(i) % S // 1000))
                        for i in range(150))], {'nanosec'}),
    'two late frames with microseconds in nanosec': (
        robot(250, lambda i: {'delay': S, 'stamp': at(i) // S * S + at(i) % S // 1000}),
        {'nanosec'}),
    'a huge quaternion': (
        with_pose(robot(), 7, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e200)), {'unnormalized'}),
}


def test_holes_after_a_step_back(capsys, tmp_path):
    """They are found by stamps, also where frames have several; `late` is no fault of its own."""
    def stamp(i):  # they go back to 25 s after 75 s, and from 55 s to 75 s after 105 s
        return at(i) - (50 * S if 3750 <= i < 5250 else 30 * S if i >= 5250 else 0)

    content = [static('map odom'), *(
        tf(i, *(['odom base_link'] * (not 300 < i < 1050) + ['base_link arm'] * (
            not 2900 < i < 3400)), stamp=stamp(i), x=0.0) for i in range(0, 6000, 5))]
    _, found = doctor(capsys, bags.make(tmp_path, 'mcap', content))
    assert [(each['code'], each['frames'], each['evidence'].partition(';')[0])
            for each in found['findings']] == [
        ('gap', ['base_link'], 'no transform of base_link for 15 s after 1700000006.000000000'),
        ('gap', ['arm'], 'no transform of arm for 10 s after 1700000058.000000000'),
        ('time_goes_back', ['base_link', 'arm'],
         '2 of 2152 transforms of base_link, arm with an earlier stamp than the one before')]


def with_kinds(names):
    """Pair each name with a kind of bag."""
    return [*zip(names, cycle(reversed(KINDS)))]


@pytest.mark.parametrize(('code', 'kind'), with_kinds(FAULTS))
def test_each_fault(capsys, tmp_path, code, kind):
    """The fault is found: its code, severity, frames, topics, nodes, evidence and remedy."""
    content, frames, evidence = FAULTS[code]
    status, found = doctor(capsys, bags.make(tmp_path, kind, in_order(content, kind)))
    findings = {finding['code']: finding for finding in found['findings']}
    assert findings.keys() == {code} | ALSO.get(code, set())
    finding = findings[code]
    assert sorted(finding['frames']) == sorted(frames)
    assert re.search(evidence, finding['evidence'])
    assert (finding['severity'], finding['time']) == (CHECKS[code].severity, TIMES.get(code, 0))
    assert finding['remedy'] == CHECKS[code].remedy
    if kind != 'bag':
        assert finding['nodes'] == []
    elif finding['topics'] and finding['topics'][0].startswith('/tf'):
        assert finding['nodes']
    assert status == int(finding['severity'] == 'error')


@pytest.mark.parametrize('name', CASES)
def test_cases(capsys, tmp_path, name):
    """What is found is what is wrong."""
    content, expected = CASES[name]
    kind = 'bag' if 'two_publishers' in expected else 'mcap'
    _, found = doctor(capsys, bags.make(tmp_path, kind, in_order(content, kind)))
    assert {finding['code'] for finding in found['findings']} == expected
    assert capsys.readouterr().err == ''


URDF = """<robot name="gripper">
<link name="base"/><link name="arm"/><link name="left"/><link name="right"/><link name="tip"/>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/></joint>
<joint name="grip" type="prismatic"><parent link="arm"/><child link="left"/>
<limit lower="0" upper="0.1" effort="1" velocity="1"/></joint>
<joint name="follow" type="prismatic"><parent link="arm"/><child link="right"/>
<limit lower="0" upper="0.1" effort="1" velocity="1"/><mimic joint="grip"/></joint>
<joint name="end" type="fixed"><parent link="left"/><child link="tip"/></joint></robot>"""


def with_robot(kind, names, *, namespace='', urdf=URDF):
    """Return messages with a description, and with joint states of some names."""
    version = 1 if kind == 'bag' else 2
    messages = [(f'{namespace}/robot_description', T, bags.string(urdf, version), bags.STRING)]
    return messages + [(f'{namespace}/joint_states', T + i * MS, bags.joint_state(names, version),
                        bags.JOINT_STATE) for i in range(10 if names else 0)]


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize(('names', 'edges', 'expected'), [
    (['turn', 'grip'], ('base arm', 'arm left', 'arm right', 'left tip'), {}),
    ([], ('base arm', 'arm left', 'arm right', 'left tip'), {}),  # sent by another program
    (['turn'], ('base arm', 'left tip'), {'joint_without_state': (
        ['left', 'right'], '1 of 2 movable joints are not on /joint_states, which names turn: '
                           'grip')}),
    # That a frame has children does not mean that a transform leads to it.
    (['grip'], ('arm left', 'arm right', 'left tip', 'x base'), {'joint_without_state': (
        ['arm'], '1 of 2 movable joints are not on /joint_states, which names grip: turn')}),
    (['turn', 'grip'], ('base arm', 'arm left', 'arm right'), {'link_without_transform': (
        ['tip'], '1 of 5 links have no transform: tip')}),
    ([], ('x y',), {
        'joint_without_state': (
            ['arm', 'left', 'right'], '2 of 2 movable joints are not on /joint_states, where '
                                      'nothing was received: turn, grip'),
        'link_without_transform': (
            ['base', 'tip'], '2 of 5 links have no transform: base, tip')}),
])
def test_robots(capsys, tmp_path, kind, names, edges, expected):
    """Joints without states and links without transforms are named; nothing is named twice."""
    path = bags.make(tmp_path, kind, in_order([
        *(tf(i, *edges) for i in range(100)), *with_robot(kind, names)]))
    status, found = doctor(capsys, path, '--ignore', 'several_trees')
    assert {each['code']: (each['frames'], each['evidence'])
            for each in found['findings']} == expected
    assert status == ('joint_without_state' in expected)


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize(('good', 'names', 'fault', 'evidence'), [
    ([], ['turn', 'grip'], {'stamp': 0}, ['2 have the stamp 0: turn, grip']),
    (['grip'], ['turn', 'grip'], {'positions': 1}, [
        '1 do not have a position for each name: turn']),
    ([], ['turn'], {'stamp': 0}, [
        '1 have the stamp 0: turn',
        '1 of 2 movable joints are not on /joint_states, which names turn: grip']),
])
def test_joint_states_that_are_ignored(capsys, tmp_path, kind, good, names, fault, evidence):
    """The report says why; one good message about a joint is enough."""
    state = bags.joint_state(names, 1 if kind == 'bag' else 2, **fault)
    path = bags.make(tmp_path, kind, in_order([
        *(tf(i, 'x base') for i in range(100)), *with_robot(kind, good),
        *(('/joint_states', T + (i * 30 + 7) * MS, state, bags.JOINT_STATE) for i in range(3))]))
    _, found = doctor(capsys, path)
    assert [re.sub(r'(\d) of 2 .* only in messages that (.*), which robot_state_publisher ignores',
                   r'\1 \2', each['evidence']) for each in found['findings']
            if each['code'] == 'joint_without_state'] == evidence


def test_robots_with_prefixes(capsys, tmp_path):
    """Each robot has its own joint states, and a prefix of its frames."""
    edges = [f'{robot}base {robot}arm' for robot in ('r1/', 'r2_')]
    path = bags.make(tmp_path, 'mcap', in_order([
        *(tf(i, *edges) for i in range(100)),
        *with_robot('mcap', ['turn'], namespace='/r1'),
        *with_robot('mcap', ['turn', 'grip'], namespace='/r2')]))
    _, found = doctor(capsys, path, '--ignore', 'several_trees')
    assert [(each['code'], each['topics'], each['frames']) for each in found['findings']] == [
        ('joint_without_state', ['/r1/joint_states'], ['r1/left', 'r1/right']),
        ('link_without_transform', ['/r1/robot_description'], ['r1/tip']),
        ('link_without_transform', ['/r2/robot_description'], ['r2_left', 'r2_right', 'r2_tip'])]


@pytest.mark.parametrize(('namespace', 'expected'), [('/left', ['left/tip']), ('', [])])
def test_robots_of_other_namespaces(capsys, tmp_path, namespace, expected):
    """A robot belongs to the nearest namespace with transforms."""
    edges = 'base arm', 'arm left', 'arm right', 'left tip'
    left = [f'left/{edge.replace(" ", " left/")}' for edge in edges[:3]]
    path = bags.make(tmp_path, 'mcap', in_order([
        *(tf(i, *edges) for i in range(100)),
        *(tf(i, *left, topic='/left/tf') for i in range(100)),
        *with_robot('mcap', ['turn', 'grip']),
        *with_robot('mcap', ['turn', 'grip'], namespace='/left')]))
    _, found = doctor(capsys, path, *(['--namespace', namespace] if namespace else []))
    assert [each['frames'] for each in found['findings']] == [expected] * bool(expected)


def test_joints_that_follow_others(capsys, tmp_path):
    """They miss the state of the one that they follow in the end, and are not named twice."""
    urdf = URDF.replace('<joint name="end" type="fixed">', '<joint name="end" type="continuous">'
                        '<mimic joint="follow"/>')
    path = bags.make(tmp_path, 'mcap', in_order([
        *(tf(i, 'base arm') for i in range(100)), *with_robot('mcap', ['turn'], urdf=urdf)]))
    _, found = doctor(capsys, path)
    assert [(each['code'], each['frames']) for each in found['findings']] == [
        ('joint_without_state', ['left', 'right', 'tip'])]


def test_joint_states_on_another_topic(capsys, tmp_path):
    """The remedy is a remapping, which gives all links their transforms."""
    state = '/arm/joint_states', T, bags.joint_state(['turn', 'grip']), bags.JOINT_STATE
    path = bags.make(tmp_path, 'mcap', in_order([
        *(tf(i, 'x base') for i in range(100)), *with_robot('mcap', []), state]))
    _, found = doctor(capsys, path)
    (finding,) = found['findings']
    assert finding['evidence'] == ('2 of 2 movable joints are not on /joint_states, but on '
                                   '/arm/joint_states: turn, grip')
    assert finding['remedy'] == 'Remap one of them: -r /joint_states:=/arm/joint_states.'


def test_a_description_that_is_refused(capsys, tmp_path):
    """The report says why nothing is checked."""
    path = bags.make(tmp_path, 'db3', in_order([
        *robot(), *with_robot('db3', [], urdf='<robot name="x">')]))
    _, found = doctor(capsys, path)
    assert not found['findings']
    assert any('robot description on /robot_description: ' in text
               and 'not valid XML' in text for text in found['not_checked'])


def robots_in_bag(path):
    """Return the robots of a bag."""
    found = RobotsInBag()
    for message in bags.messages(path, tf=False, others=found.wanted):
        found.add(message)
    return found.robots()


@pytest.mark.parametrize(('kind', 'links'), [('floating', {'a', 'b'}), ('planar', set())])
def test_only_the_links_of_floating_joints_are_not_sent(tmp_path, kind, links):
    """robot_state_publisher sends a planar joint as a fixed one."""
    urdf = (f'<robot name="x"><link name="a"/><link name="b"/><joint name="j" type="{kind}">'
            '<parent link="a"/><child link="b"/></joint></robot>')
    (found,) = robots_in_bag(bags.make(tmp_path, 'mcap', with_robot('mcap', [], urdf=urdf)))
    assert {*found.floating} == links


def test_many_descriptions(capsys, tmp_path):
    """Twenty are read, also if they are sent again; one line says that others are left out."""
    path = bags.make(tmp_path, 'mcap', in_order([*robot(), *(
        (f'/r{i}/robot_description', T + i * MS + j, bags.string(urdf), bags.STRING)
        for j, urdf in enumerate(('', URDF)) for i in range(25))]))
    _, found = doctor(capsys, path)
    assert [text for text in found['not_checked'] if 'robot description' in text] == [
        'the robot description on /r20/robot_description: left out, with any further ones: at '
        'most 20 are read']
    assert len(robots_in_bag(path)) == 21


def test_descriptions_and_joint_states_that_are_not_kept(tmp_path, monkeypatch):
    """Memory is for one message at a time, if others are too many or too long."""
    monkeypatch.setattr(observed, 'MAX_SIZE', 1000)
    path = bags.make(tmp_path, 'mcap storage', [*robot(), *(
        message for i in range(40) for message in (
            (f'/r{i}/robot_description', T + i, bags.string(f'{i}' * 1_000_000), bags.STRING),
            (f'/x{i}/joint_states', T + i, bags.joint_state([f'{i}' * 1_000_000]),
             bags.JOINT_STATE)))])
    robots_in_bag(path)  # so that no module is imported later
    tracemalloc.start()
    try:
        assert [each.topic for each in robots_in_bag(path)] == [
            f'/r{i}/robot_description' for i in range(21)]
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize('kind', KINDS)
def test_another_type(capsys, tmp_path, kind):
    """The topic and its type are named; what the other topic has is checked all the same."""
    path = bags.make(tmp_path, kind, [static('map odom', 'base lamp'), WRONG])
    status, found = doctor(capsys, path)
    error, info = found['findings']
    assert (status, error['code'], error['severity']) == (1, 'wrong_type', 'error')
    assert error['topics'] == ['/tf']
    assert 'geometry_msgs/msg/TransformStamped on /tf, not tf2_msgs/msg/TFMessage' in (
        error['evidence'])
    assert 'TransformBroadcaster' in error['remedy']
    assert info['code'] == 'several_trees'
    assert not any('/tf' in text for text in found['not_checked'])


@pytest.mark.parametrize(('name', 'kind'), with_kinds(HEALTHY))
def test_healthy(capsys, tmp_path, name, kind):
    """Nothing is found where nothing is wrong."""
    status, found = doctor(capsys, bags.make(tmp_path, kind, in_order(HEALTHY[name], kind)))
    assert (status, found['findings']) == (0, [])
    assert found['verdict'].startswith('healthy: ')


def test_only_static_transforms(tmp_path):
    """That is right for a robot with fixed joints, so it is said in the verdict only."""
    path = bags.make(tmp_path, 'mcap', [static('map lamp')])
    assert examine(path).verdict == (
        f'healthy: 1 transform of 2 frames in {path}, no dynamic transforms')


@pytest.mark.parametrize('kind', ['bag', 'mcap'])
@pytest.mark.parametrize(('late', 'number'), [(100, 50), (30, 50), (14, 0), (17, 20)])
def test_a_late_transform_of_the_old_run(capsys, tmp_path, kind, late, number):
    """How many transforms a buffer refuses after it is said, and the stamp because of which."""
    stamps = [late, *(5 + i / 10 for i in range(50))]
    buffer = TransformBuffer(cache_time=10 * S)
    accepted = [buffer.insert(round(stamp * S), 'odom', 'base', pose(0.0)) for stamp in stamps]
    assert accepted.count(False) == number
    path = bags.make(tmp_path, kind, [
        tf(i, 'odom base', stamp=round(stamp * S), publisher='/sim' if i else '/old_node')
        for i, stamp in enumerate(stamps)])
    _, found = doctor(capsys, path)
    texts = [each['evidence'] for each in found['findings'] if 'refuses' in each['evidence']]
    assert {each['code'] for each in found['findings']} <= {'time_goes_back'}
    assert [text.partition(', from ')[2] for text in texts] == [
        f'{late}.000000000; a buffer with the default cache of 10 s refuses {number} transforms'
    ] * bool(number)


# In a program


def test_examine(tmp_path):
    """A program gets the findings as objects, and the text of the command."""
    path = bags.make(tmp_path, 'mcap', in_order(FAULTS['static_and_dynamic'][0]))
    done: list[float] = []
    with bag.open(path, on_progress=done.append) as opened:
        report = examine(opened)
    assert str(report) == str(examine(path))
    (finding,) = report.findings
    assert report.has_errors
    assert (finding.code, finding.severity, finding.frames) == (
        'static_and_dynamic', ERROR, ('base_link',))
    assert str(report).startswith('error static_and_dynamic: base_link\n')
    assert str(report).endswith(f'\n1 error: 203 transforms of 5 frames in {path}')
    assert done[-1] == 1.0
    report = examine(str(path), ignore=['static_and_dynamic', 'two_publishers'])
    assert report.verdict.startswith('healthy: ')
    assert not any('two_publishers' in text for text in report.not_checked)


def test_examine_refuses(tmp_path):
    """An unknown code and a bag that does not exist are errors."""
    with pytest.raises(ValueError, match="unknown code 'gaps'"):
        examine(tmp_path, ignore=['gaps'])
    with pytest.raises(FileNotFoundError, match='missing'):
        examine(tmp_path / 'missing')


# The command


def test_the_text(capsys, tmp_path):
    """It prints each finding with its evidence and remedy, what was not checked, the verdict."""
    path = bags.make(tmp_path, 'mcap', in_order(FAULTS['static_and_dynamic'][0]))
    assert main(['--bag', str(path)]) == 1
    assert capsys.readouterr().out.splitlines() == [
        'error static_and_dynamic: base_link',
        "    transforms of 'base_link': 100 on /tf, 1 on /tf_static.",
        '    On /tf_static, /tf.',
        '    Let only one of the two topics have the frame. More: tf_doctor --explain jump',
        '',
        'not checked: no_clock, other_user, incompatible_qos, silent_publisher, '
        'volatile_listener: a bag does not record the listeners',
        'not checked: static_not_latched: the bag does not record the QoS of the publishers',
        'not checked: two_publishers, many_publishers: the bag does not record which node has '
        'sent a message',
        '',
        f'1 error: 203 transforms of 5 frames in {path}']


def test_list(capsys):
    """It explains all codes; each has a severity, a meaning and a remedy of one sentence."""
    assert main(['--list']) == 0
    output = capsys.readouterr().out
    for check in CHECKS.values():
        text = f'{check.meaning} {check.advice}'.strip()
        assert f'{check.code} ({check.severity})\n    {text}\n' in output
        assert check.meaning.endswith('.')
        assert re.fullmatch(r'([A-Z](?:[^.]|\.\S)*[.?])?', check.remedy)


def test_malformed_messages(capsys, tmp_path):
    """Messages that cannot be decoded are listed."""
    path = bags.make(tmp_path, 'mcap', [
        *in_order(robot()), ('/tf', T + 10 * S, b'\0\1\0\0\1\0\0')])
    _, found = doctor(capsys, path)
    assert any('1 message' in text and 'truncated' in text for text in found['not_checked'])
    assert found['verdict'].startswith('nothing found: ')  # not: healthy
    assert not any('missing' in text for text in found['not_checked'])


def test_a_type_without_a_definition(capsys, tmp_path):
    """Topics whose type is not known are listed as not checked."""
    path = bags.mcap(tmp_path / 'own.mcap', bags.mcap_channel(), bags.mcap_channel(
        '/thing', 2, 'my_msgs/msg/Thing'), bags.mcap_message([bags.row(T, 'map', 'odom')], T))
    status, found = doctor(capsys, path)
    assert (status, found['findings']) == (0, [])
    assert found['not_checked'][-1] == (
        'headers on /thing: the definition of its type my_msgs/msg/Thing is not known')


# The path between two frames


def test_a_path_that_exists(capsys, tmp_path):
    """Each edge is listed with its rate, its stamps and its publisher."""
    path = bags.make(tmp_path, 'bag', in_order(robot()))
    assert main(['--bag', str(path), 'map', '/arm']) == 0
    assert capsys.readouterr().out.splitlines()[2:] == [
        'map -> odom        static                                                 /fixed',
        'odom -> base_link  50.0 Hz  1700000000.000000000 to 1700000001.980000000  /robot',
        'base_link -> arm   50.0 Hz  1700000000.000000000 to 1700000001.980000000  /robot',
        '',
        'The transform from arm to map exists at +1.98 s, 1700000001.980000000.']


def test_a_path_at_a_time_in_a_hole(capsys, tmp_path):
    """The explanation says that the transform is interpolated, in both forms of time."""
    path = bags.make(tmp_path, 'mcap', in_order([
        each for each in robot() if not T + S // 2 < each[1] < T + 3 * S // 2]))
    assert main(['--bag', str(path), 'map', 'arm', '-t', '+1']) == 0
    text = capsys.readouterr().out
    assert 'exists at +1 s, 1700000001.000000000. It is interpolated between +0.' in text
    assert re.search(r'and \+1\.\d\d s: \w+ -> \w+ has no data there\.', text)


def test_the_ends_of_the_data_can_be_typed(capsys, tmp_path):
    """There is a transform at the last stamp that is printed, and none a nanosecond later."""
    path = bags.make(tmp_path, 'mcap', [
        tf(i, 'map odom', stamp=at(i) + 123_456_789) for i in range(50)])
    main(['--bag', str(path), 'map', 'odom'])
    ((begin, end),) = re.findall(r'Hz  (\S+) to (\S+)', capsys.readouterr().out)
    for time, code in (begin, 0), (end, 0), (Decimal(end) + Decimal('1e-9'), 1):
        assert main(['--bag', str(path), 'map', 'odom', '-t', str(time)]) == code
        capsys.readouterr()


def explained(capsys, path, *arguments):
    """Return the exit code, the refusals by child, and why there is no transform."""
    code, data = doctor(capsys, path, *arguments)
    return code, {edge['name']: edge['refusal'] for edge in data['path']}, data['why_not']


def test_the_edge_that_refuses(capsys, tmp_path):
    """The edge without data at the time is named, with how far its data are away."""
    content = [*robot(), *(tf(i, 'arm hand') for i in range(100, 110))]
    path = bags.make(tmp_path, 'mcap', in_order(content))
    code, refusals, why = explained(capsys, path, 'map', 'hand', '-t', '1700000001.5')
    assert (code, *map(bool, (refusals['odom'], refusals['arm']))) == (1, False, False)
    assert refusals['hand'].startswith('its oldest transform is 0.500 s newer than 1700000001.5')
    assert 'extrapolation into the past' in why
    code, refusals, _ = explained(capsys, path, 'map', 'hand')  # the two are never known at once
    assert code == 1
    assert refusals['hand'].startswith('its oldest transform is 0.020 s newer')
    code, refusals, _ = explained(capsys, path, 'hand', 'arm', '-t', '1700000003')
    assert refusals == {'hand': refusals['hand']}
    assert 'older than 1700000003' in refusals['hand']


def test_two_trees_and_unknown_frames(capsys, tmp_path):
    """Without a path, the edges up to both roots are listed; the error names roots or frames."""
    path = bags.make(tmp_path, 'mcap', in_order([*robot(), static('world lamp')]))
    code, refusals, why = explained(capsys, path, 'base_link', 'lamp')
    assert (code, [*refusals]) == (1, ['base_link', 'odom', 'lamp'])
    assert "'base_link' is in the tree with root 'map'" in why
    code, refusals, why = explained(capsys, path, 'map', 'lmap')
    assert (code, refusals) == (1, {})
    assert "Nearest known: 'map', 'lamp'" in why


def test_a_loop_and_one_frame(capsys, tmp_path):
    """A loop has no path; a frame and itself are always connected."""
    path = bags.make(tmp_path, 'mcap', in_order(FAULTS['loop'][0]))
    code, refusals, why = explained(capsys, path, 'a', 'c')
    assert (code, refusals, why) == (0, {}, '')
    code, refusals, why = explained(capsys, path, 'a', 'a')
    assert (code, refusals, why) == (0, {}, '')


def test_a_parent_that_changed(capsys, tmp_path):
    """The path is that of the requested time."""
    path = bags.make(tmp_path, 'mcap', in_order([
        *robot(), *(tf(i, 'arm cup' if i < 50 else 'laser cup') for i in range(100))]))
    for stamp, parent in (T + S // 2, 'arm'), (T + 3 * S // 2, 'laser'):
        code, refusals, why = explained(
            capsys, path, 'base_link', 'cup', '-t', f'{stamp / S:.1f}')
        assert (code, refusals, why) == (0, {parent: '', 'cup': ''}, '')


def test_an_edge_with_the_stamp_0(capsys, tmp_path):
    """The latest time is that of the other edges, as for a lookup."""
    path = bags.make(tmp_path, 'mcap', in_order([
        *robot(), *(tf(i, 'base_link x', stamp=0) for i in range(10))]))
    code, refusals, why = explained(capsys, path, 'odom', 'x')
    assert (code, refusals['base_link']) == (1, '')
    assert 'older than' in refusals['x']
    assert why
    assert main(['--bag', str(path), 'base_link', 'x']) == 0
    assert ('from x to base_link exists only at the time 0.' in
            capsys.readouterr().out)


@pytest.mark.parametrize(('first', 'every'), [(1, 2), (3, 5), (100, 200)])
@pytest.mark.parametrize('frames', ['odom base_link', 'map odom'])
def test_a_frame_that_flickers(capsys, tmp_path, frames, first, every):
    """A bag of ROS 2 does not record that two nodes publish it; odom may jump in map, seldom."""
    path = bags.make(tmp_path, 'mcap', [
        tf(i, frames, x=i / 100 + 3.0 * (i % every >= first)) for i in range(200)])
    code, found = doctor(capsys, path)
    (finding,) = found['findings']
    assert (code, finding['code']) == (0, 'jump')
    jumps = int(finding['evidence'].split()[0])
    assert jumps > 70 if every < 10 else jumps == 1
    assert finding['severity'] == ('info' if frames == 'map odom' and jumps == 1 else 'warning')


# Recordings


def profile(durability):
    """Return the QoS of a publisher, as rosbag2 records it."""
    lasting = QosTime(0, 0)
    return Qos(QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, durability, lasting, lasting,
               QosLiveliness.AUTOMATIC, lasting, False)


@pytest.mark.parametrize('kind', ['mcap', 'db3'])
@pytest.mark.parametrize(('durabilities', 'unlatched'), [
    ('TRANSIENT_LOCAL', ''), ('TRANSIENT_LOCAL TRANSIENT_LOCAL', ''),
    ('VOLATILE', 'Publishers on /tf_static (1) are not'),
    ('TRANSIENT_LOCAL VOLATILE SYSTEM_DEFAULT', 'Publishers on /tf_static (2) are not'),
    ('UNKNOWN', None), ('UNKNOWN TRANSIENT_LOCAL', ''), ('', None)])
def test_the_recorded_qos(capsys, tmp_path, kind, durabilities, unlatched):
    """Each publisher on /tf_static must be transient local; an empty list says nothing."""
    path = bags.make(tmp_path, kind, in_order(robot()), [
        profile(QosDurability[name]) for name in durabilities.split()])
    for options in ([], ['--partial']) if kind == 'mcap' else ([],):
        code, found = doctor(capsys, path, *options)
        assert code == int(bool(unlatched))
        assert [each['evidence'] for each in found['findings']] == [
            f'{unlatched} transient local: listeners that require it receive nothing'
        ] * bool(unlatched)
        assert all(each['code'] == 'static_not_latched' for each in found['findings'])
        assert any('static_not_latched' in text for text in found['not_checked']) is (
            unlatched is None)


def test_the_recorded_qos_of_a_split_bag(tmp_path):
    """Each part records the QoS of the same publishers, which count once."""
    files = [bags.file_of(bags.make(tmp_path / str(number), 'mcap', content, [profile(
        QosDurability.VOLATILE)] * 2)).rename(tmp_path / f'x_{number}.mcap')
        for number, content in enumerate((in_order(robot()), [static('map odom', time=T + S)]))]
    (finding,) = examine(iter(files)).findings
    assert finding.evidence.startswith('Publishers on /tf_static (2) are not transient local')


def test_the_qos_that_rosbag2_writes(tmp_path):
    """Before Jazzy, the policies are numbers, and the profiles a text in YAML."""
    path = bags.file_of(bags.make(tmp_path, 'db3', in_order(robot())))
    for durability, count in (1, 0), (2, 1):
        text = (f'- history: 3\n  depth: 0\n  reliability: 1\n  durability: {durability}\n'
                '  deadline:\n    sec: 9223372036\n    nsec: 854775807\n  lifespan:\n'
                '    sec: 9223372036\n    nsec: 854775807\n  liveliness: 1\n'
                '  liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n'
                '  avoid_ros_namespace_conventions: false')
        with closing(sqlite3.connect(path)) as database:
            database.execute('UPDATE topics SET offered_qos_profiles = ? '
                             "WHERE name = '/tf_static'", [text])
            database.commit()
        assert [each.code for each in examine(path).findings] == ['static_not_latched'] * count


@pytest.mark.parametrize('shift', [1, 3, 9])
def test_two_publishers_that_are_not_recorded(tmp_path, shift):
    """The frame jumps, whatever the time between their stamps; there are no gaps."""
    sent = [static('map odom'), *(tf(i, 'odom base_link', x=x, stamp=at(i) + x * shift * MS)
                                  for i in range(100) for x in (0, 1))]
    report = examine(bags.make(tmp_path, 'mcap', in_order(sent)))
    assert [finding.code for finding in report.findings] == ['jump']


def test_a_missing_part(tmp_path):
    """The first part is named, and what it may have is not missed; or it may be another file."""
    first, later = (bags.file_of(bags.make(tmp_path / name, 'mcap', in_order(content)))
                    for name, content in (('a', robot()), ('b', [*robot()[1:], *points(
                        '/scan', 'laser'), tf(0, 'world lamp'), *points('/lamp', 'lamp', 'arm')])))
    first, later = (file.rename(tmp_path / f'robot_{i}.mcap')
                    for i, file in enumerate((first, later)))
    report = examine(later)
    (finding,) = report.findings
    assert (finding.code, finding.evidence) == ('missing_part', (
        f'{later} is without the first part of its recording, which usually has all static '
        f'transforms: read {first}, too'))
    assert [text for text in report.not_checked if text.startswith('unknown_frame, ')
            and text.endswith('several_trees: a part of the recording is missing or damaged')]
    assert 'unknown_frame' not in {each.code for each in examine([first, later]).findings}
    renamed = {each.code: each for each in examine(later.rename(tmp_path / 'x.mcap')).findings}
    for code, what in ('unknown_frame', 'lead to it'), ('disconnected', 'connect them'):
        fault = renamed[code]
        assert (fault.severity, fault.remedy.partition(', too, or read the part')[0]) == (
            'warning', f'If static transforms {what}, record /tf_static')
        assert '; the bag has no static transforms' in fault.evidence


def test_a_bag_that_is_cut_off_is_not_called_healthy(capsys, tmp_path):
    """Nobody knows what is in the lost part."""
    path = bags.checked_mcap(tmp_path / 'x.mcap', seconds=4)
    path.write_bytes(path.read_bytes()[:-5000])
    code, found = doctor(capsys, path, '--partial')
    assert (code, found['findings']) == (0, [])
    assert found['verdict'].startswith('nothing found: ')


@pytest.mark.parametrize('fault', ['not given', 'cut off', 'removed'])
def test_a_gap_in_the_recording(tmp_path, fault):
    """It is named, and no node is blamed for it, but for a silence that is longer."""
    sent = [tf(i, 'odom base_link', *['base_link arm'] * (not 150 < i < 310)) for i in range(400)]
    files = [bags.file_of(bags.make(tmp_path / f'{i}', 'mcap', sent[100 * i:][:100])).rename(
        tmp_path / f'walk_{i}.mcap') for i in range(4)]
    (tmp_path / 'metadata.yaml').write_text('relative_file_paths:\n' + ''.join(
        f'  - {file.name}\n' for file in files))
    if fault == 'cut off':
        files[2].write_bytes(files[2].read_bytes()[:-5000])
    else:
        files.pop(2).unlink()
    with bag.open(files if fault == 'not given' else tmp_path, partial=True) as opened:
        report = examine(opened)
    assert [(each.code, each.frames) for each in report.findings] == [('gap', ('arm',))]
    assert report.not_checked[-1] == (
        'gap in the 2.02 s after 1700000003.981000000: a part of the recording is missing or '
        'damaged')
    where = ', '.join([str(files[0]), *(file.name for file in files[1:])])
    assert report.verdict.endswith(
        f' frames in what is left of {where if fault == "not given" else tmp_path}')


@pytest.fixture
def several(tmp_path):
    """Bags: two healthy ones, one of two parts, one that is cut off, one with a fault."""
    paths = [bags.make(tmp_path / f'{name}.bag', 'bag', in_order(robot())) for name in 'ab']
    paths += (bags.file_of(bags.make(tmp_path / name, 'mcap', in_order(content))).rename(
        tmp_path / f'split_{i}.mcap') for i, (name, content) in enumerate((
            ('x', robot()), ('y', [tf(100 + i, 'odom base_link', 'base_link arm')
                              for i in range(100)]))))
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(paths[2].read_bytes()[:-100])
    faulty = bags.make(tmp_path / 'faulty.bag', 'bag', in_order(FAULTS['loop'][0]))
    empty = tmp_path / 'empty'
    empty.mkdir()
    return [*paths, cut, faulty, empty, tmp_path / 'missing.mcap']


@pytest.mark.parametrize('jobs', [[], ['--jobs', '1'], ['--jobs', '3']])
def test_many_bags(capsys, several, jobs):
    """There is one line of JSON for each, in their order, also for one that is broken."""
    assert main(['--bag', *map(str, several), *jobs, '--json']) == 1
    out, err = capsys.readouterr()
    results = [json.loads(line) for line in out.splitlines()]
    names = [path.name for path in several]
    names.remove('split_1.mcap')
    assert [result['bag'] for result in results] == [
        str(several[0].with_name(name)) for name in names]
    assert [('error' if 'error' in result else result['verdict'].partition(':')[0])
            for result in results] == [
        'healthy', 'healthy', 'healthy', 'error', '1 error', 'error', 'error']
    assert 'it ends too early' in results[3]['error']
    assert 'empty is not a bag' in results[5]['error']
    assert results[6]['error'] == f'cannot read {several[-1]}: No such file or directory'
    assert err == '7 bags: 3 without errors, 1 with errors, 3 not readable\n'


def test_many_bags_in_text(capsys, several):
    """Reports follow each other; errors go to stderr."""
    assert main(['--bag', *map(str, several[:2]), str(several[4])]) == 1
    out, err = capsys.readouterr()
    assert out.count('\n\nhealthy: ') == 2
    assert re.fullmatch(r'tf_doctor: \S+cut\.mcap cannot be read: .*\n3 bags: 2 without errors, '
                        r'0 with errors, 1 not readable\n', err)


def test_examine_bag(several):
    """It can be pickled, and so can its result, which is what the command prints."""
    function = pickle.loads(pickle.dumps(partial(examine_bag, ignore=['loop'])))
    result = function(several[5])
    assert json.loads(json.dumps(result)) == result == pickle.loads(pickle.dumps(result))
    assert result['findings'] == []
    assert examine_bag(str(several[-1]))['error'].startswith('cannot read ')


def test_a_process_that_is_killed(capsys, monkeypatch, several):
    """It costs the report of its bag only."""
    monkeypatch.setattr('puretf_tools.commands.tf_doctor.examine_bag',
                        bags.examine_unless_faulty)
    assert main(['--bag', *map(str, several), '--jobs', '2', '--json']) == 1
    results = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [result.get('error', 'healthy')[:40] for result in results if 'faulty' in result['bag']
            ] == ['the process that read ' + str(several[5])[:18]]
    assert sum('error' not in result for result in results) == 3


@pytest.mark.parametrize(('stamp', 'time', 'where'), [
    (-1, 2**63 - 1, 'behind'), (-2**31 * S, 2**63 - 1, 'behind'), (-2**31 * S, 1, 'behind'),
    (2**31 * S - 1, 1, 'ahead of'), (2**31 * S - 1, 2**63 - 1, 'behind')])
def test_times_at_the_ends_of_their_range(tmp_path, stamp, time, where):
    """No difference overflows: the stamps are on the right side of the arrival."""
    odd = [('/tf', time, [bags.row(stamp, 'map', 'odd')]),
           ('/points', time, ('odd', stamp))]
    path = bags.make(tmp_path, 'mcap', in_order([*robot(), *odd]))
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        report = examine(path)
    (finding,) = (each for each in report.findings if each.code == 'other_clock')
    assert finding.frames == ('odd',)
    assert f' s {where} the arrival; ' in finding.evidence
