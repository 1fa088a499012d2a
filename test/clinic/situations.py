"""
Situations from public reports, as data, and the codes of their causes.

The numbers are those of the two logs from which they are: `2.5` is row 5 of the second one.
`ELSEWHERE` has the other rows.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Optional

from world import Lookup, NOW, S, Sender, Sensor, STILL, World

from puretf._causes.facts import Blocked
from puretf._core.pose import Pose
from puretf_tools.robot.observed import Robot


class Situation(NamedTuple):
    """A situation, and the lookups in it."""

    name: str
    world: World
    lookups: list[Lookup]
    #: The codes of what `tf_doctor` finds; None: those of the causes that it can know.
    finds: Optional[Sequence[str]] = None
    #: What the remedies change, of which each is enough: fields of the world, and of the lookups.
    after: Sequence[Mapping[str, Any]] = ()
    report: Sequence[str] = ()  #: texts in the report of `tf_doctor`

    def healed(self) -> list['Situation']:
        """Return the same after each of the remedies: lookups have no error."""
        return [Situation(f'{self.name}, after remedy {i}', changed(self.world, changes), [
            changed(lookup, {**changes, 'causes': None}) for lookup in self.lookups])
            for i, changes in enumerate(self.after)]


def changed(record: Any, changes: Mapping[str, Any]) -> Any:
    """Return a NamedTuple with those of the changes that are its fields."""
    return record._replace(**{name: changes[name] for name in changes if name in record._fields})


SCAN_OF_LIDAR = 'the clock of this node'
DRIVER = Sender('/driver', ['odom base_link'])
LASER = Sender('/rsp', ['base_link laser'], 0, '/tf_static')
AMCL = Sender('/amcl', ['map odom'], 10, offset=0.5)
SLAM = Sender('/slam', ['map odom'], 10)
#: A listener that has been there for a long time, and so has dropped transforms.
LONG = -20.0
#: What the time on /clock is, and a node whose stamps are of it.
SIM: dict[str, Any] = {'clock': 100.0, 'clock_nodes': ['/gazebo']}
SIM_DRIVER = DRIVER._replace(offset=100.0 - NOW / S)
ROBOT: dict[str, Any] = {'senders': [SLAM, DRIVER, LASER]}
AGAIN: dict[str, Any] = {'senders': [DRIVER], 'at': 0.0}


def moves(number: int) -> Pose:
    """Return the pose of a frame that moves by 1 cm from message to message."""
    return number / 100, *STILL[1:]


def arm(**states: str) -> Robot:
    """Return a robot with the joint turn, and why joint states are ignored, by joint."""
    return Robot('/robot_description', '', 'base_link', ['base_link', 'laser', 'hand'],
                 {'turn': ['hand']}, states)


def clock_off(row: str, offset: float, *causes: str, words: Sequence[str] = (),
              begin: float = LONG, report: Sequence[str] = ()) -> Situation:
    """Return a sensor whose stamps are off by some time (s), while all transforms are in time."""
    return Situation(
        f'{row}a sensor is {offset} s off, {-begin} s after the start',
        World([DRIVER._replace(begin=begin), LASER._replace(begin=begin)],
              sensors=[Sensor(offset=offset, begin=begin)]),
        [Lookup('odom', 'laser', causes, words, at=offset,
                not_words=('Skip', 'Set use_sim_time', 'publisher'))],
        finds=None if offset != -12.3 else ['message_too_old'] if begin == LONG else [],
        after=[{'sensors': [Sensor(begin=begin)], 'at': 0.0}], report=report)


FAULTY = [
    Situation('2.18 a program of another user', World(
        [Sender('unknown publisher')], other_user='teacher'),
        [Lookup('odom', 'base_link', ['other_user'], ('teacher runs nodes',))]),
    Situation('2.2 static and dynamic parent', World([
        Sender('/rsp', ['base_footprint base_link', 'base_link laser'], 0, '/tf_static'), DRIVER]),
        [Lookup('base_footprint', 'base_link', ['changing_parent'],
                ("'base_link'", "'base_footprint' (static) by /rsp", "'odom' by /driver"),
                not_words=['Publish a transform'])],
        after=[{'senders': [Sender('/rsp', ['base_footprint base_link'], 0, '/tf_static'),
                            Sender('/driver', ['odom base_footprint'])]}],
        report=["'base_link' has 2 parents: 'base_footprint' (static) by /rsp, 'odom' by /driver.",
                "Let only one parent be published for 'base_link'. "]),
    Situation('2.3 the same, the other way round', World([
        Sender('/rsp', ['base_link base_footprint', 'base_link laser'], 0, '/tf_static'),
        Sender('/sim', ['odom base_footprint'])]),
        [Lookup('odom', 'laser', ['changing_parent'],
                ("'base_footprint'", "'base_link' (static) by /rsp", "'odom' by /sim"))],
        finds=['changing_parent'],
        after=[{'senders': [Sender('/rsp', ['base_footprint base_link', 'base_link laser'], 0,
                                   '/tf_static'), Sender('/sim', ['odom base_footprint'])]}]),
    Situation('2.4 two dynamic parents that alternate', World([
        DRIVER._replace(rate=30), Sender('/slam', ['map base_link'], 30, begin=-19.99,
                                         end=-0.01)]),
        [Lookup('map', 'base_link', ['changing_parent'],
                ("'map'", "'odom' by /driver", '/slam'))],
        finds=['changing_parent'], after=[ROBOT]),
    Situation('2.5 a part has a prefix', World([
        Sender('/controller', ['robot1/odom robot1/base_link']), SLAM, LASER]),
        [Lookup('map', 'laser', ['part_prefix'], ("'robot1/odom'", "'odom'"),
                not_words=['Publish a transform'])], after=[ROBOT, {'senders': [
            Sender('/controller', ['robot1/odom robot1/base_link']),
            Sender('/slam', ['map robot1/odom']),
            LASER._replace(edges=['robot1/base_link laser'])]}]),
    Situation('2.6 only odom has the prefix', World([
        Sender('/controller', ['robot1/odom base_link']), SLAM, LASER]),
        [Lookup('map', 'laser', ['part_prefix'], ("'robot1/odom'", "'odom'"))], after=[ROBOT]),
    Situation('2.6 a prefix without a slash', World([
        Sender('/controller', ['odom robot1base_link']), SLAM, LASER]),
        [Lookup('map', 'laser', ['part_prefix'], ("'robot1base_link'", "'base_link'"))],
        after=[ROBOT]),
    Situation('2.6 odom_combined', World([
        Sender('/controller', ['odom_combined base_link']), SLAM, LASER]),
        [Lookup('map', 'laser', ['part_prefix'], ("'odom_combined'", "'odom'"))], after=[ROBOT]),
    Situation('2.7, 1.28 names that differ by case', World([
        Sender('/controller', ['Odom base_link']), SLAM]),
        [Lookup('map', 'base_link', ['similar_name'], ('almost the same',))],
        finds=['similar_name', 'several_trees'], after=[ROBOT],
        report=['warning similar_name: Odom, odom',
                "'Odom' and 'odom' are almost the same name",
                'info several_trees: Odom, map',
                '2 trees, with the roots Odom, map']),
    Situation('1.28 names that differ by a blank', World([
        DRIVER._replace(edges=['odom base_link ']), LASER]),
        [Lookup('odom', 'laser', ['similar_name'], ('almost the same',))],
        finds=['similar_name', 'several_trees'], after=[ROBOT]),
    Situation('2.7 an empty namespace before a name', World([
        SLAM._replace(edges=['map /odom']), DRIVER._replace(edges=['/odom base_link'])]),
        [Lookup('map', 'odom', None)], ['leading_slash'], [ROBOT],
        report=['warning leading_slash: /odom',
                'names in transforms begin with a slash: /odom.']),
    Situation('2.8 a localiser before its first pose', World([DRIVER, Sender('/amcl')]),
              [Lookup('map', 'base_link', ['silent_publisher'],
                      ('Nothing arrives from the publishers of /amcl on /tf',))]),
    Situation('2.9 a publisher waits for /clock', World([
        Sender('/odom_node', waits_for='/clock')]), [Lookup('odom', 'base_link', ['no_clock'],
                      ('/odom_node waits for /clock, which nothing publishes',
                       'use_sim_time'))], after=[AGAIN, {'senders': [SIM_DRIVER], **SIM}]),
    Situation('2.10 the same with a timer of the wall clock', World([
        Sender('/odom_node', ['odom base_link'], stamp=lambda _: 0, waits_for='/clock')]),
        [Lookup('odom', 'base_link', ['zero_stamp'], ('Set header.stamp',), at=-0.1)],
        after=[AGAIN, {'senders': [SIM_DRIVER], **SIM}],
        report=['error zero_stamp: base_link',
                '401 of 401 transforms of base_link with the stamp 0.']),
    Situation('2.11 a bag is played with a start offset', World([
        Sender('/rosbag2_player', ['odom base_link']),
        Sender('/rosbag2_player', topic='/tf_static')]),
        [Lookup('odom', 'laser', ['silent_publisher'],
                ('publishers of /rosbag2_player on /tf_static', 'start offset'))]),
    Situation('2.11 the same beside a localiser before its first pose', World([
        Sender('/rosbag2_player', ['odom base_link']), Sender('/amcl'),
        Sender('/rosbag2_player', topic='/tf_static')]),
        [Lookup('odom', 'laser', ['silent_publisher'],
                ('publishers of /rosbag2_player on /tf_static: a start offset',))]),
    Situation('2.12 volatile statics', World([DRIVER, LASER._replace(lacks='transient local')]),
              [Lookup('odom', 'laser', ['static_not_latched'], ('/rsp', 'not transient local'))],
              after=[ROBOT]),
    Situation('volatile statics of a node that sends other transforms, too', World([
        DRIVER, LASER._replace(node='/driver', lacks='transient local')]),
        [Lookup('odom', 'laser', ['static_not_latched'], ('/driver', 'not transient local'))],
        after=[ROBOT]),
    Situation('1.36 best effort', World([DRIVER._replace(lacks='reliable'), LASER]),
              [Lookup('odom', 'laser', ['incompatible_qos'], ('/driver', 'not reliable'))],
              after=[ROBOT]),
    Situation('2.13 joint states on another topic', World(
        [LASER, Sender('/robot_state_publisher', waits_for='/joint_states')],
        joint_states={'/robot1/joint_states': ['/driver']}),
        [Lookup('base_link', 'arm', ['joint_without_state'],
                ('/robot_state_publisher waits for /joint_states', '/robot1/joint_states',
                 '/driver', '-r /joint_states:=/robot1/joint_states'))],
        after=[{'senders': [LASER, Sender('/robot_state_publisher', ['base_link arm'])]}]),
    *(clock_off(row, offset, 'message_other_clock', words=(word, SCAN_OF_LIDAR), begin=begin,
                report=['error message_other_clock: laser', word])
      for row, offset, word in (
          ('2.19 ', -37.0, 'TAI'), ('2.21 ', 37.0, 'TAI'), ('', 18.0, 'GPS'), ('', -18.1, 'GPS'),
          ('2.22 ', -28800.0, '8:00 h'), ('', 7200.0, '2:00 h'),
          ('', 19800.0, '5:30 h'),
          ('2.25 ', -315_964_782.0, 'GPS epoch'), ('2.24 ', 1868.0 - NOW / S, 'power-on'))
      for begin in (-3.0, LONG)),
    clock_off('', 4.0, 'message_other_clock', words=('4.0 s ahead of the clock of this node',)),
    clock_off('', -12.3, 'cache_too_short', words=('cache_time of 14 s',), report=[
        'error message_too_old: laser', 'too old: when they arrive, their transforms are up to',
        'Send the messages sooner, or give the listener a cache_time of 14 s.']),
    clock_off('', -12.3, begin=-3.0, words=('No earlier transform was received',)),
    Situation('2.26 all nanoseconds in nanosec, cut to 32 bits', World([
        DRIVER._replace(nanosec=lambda stamp: stamp % 2**32)]),
        [Lookup('odom', 'base_link', ['nanosec'], at=-30.0),
         Lookup('odom', 'base_link', ['nanosec'], ('not below 1000000000',), at=5.0)],
        after=[AGAIN]),
    Situation('data ahead of the clock', World([DRIVER._replace(offset=30.0)]),
              [Lookup('odom', 'base_link', ['other_clock'], ('30.0 s ahead of',), at=0.0)],
        finds=['future'], after=[AGAIN],
        report=['warning future: base_link', 'with stamps up to 30.0 s ahead of the arrival.']),
    *(Situation(f'2.28 refused: {code}', World([DRIVER, Sender(
        '/imu', ['base_link tool'], pose=pose)], has_gids=True),
        [Lookup('odom', 'tool', [code], ("'tool' from /imu were refused",))],
        after=[{'senders': [DRIVER, Sender('/imu', ['base_link tool'])]}],
        report=[f'error {code}: tool', f'401 of 401 transforms of tool with {what}'])
      for code, pose, what in (
          ('not_a_number', lambda _: (float('nan'), *STILL[1:]), 'NaN or an infinite number.'),
          ('unnormalized', lambda _: (0.0,) * 7,
           'a quaternion whose norm differs from 1 by up to 1.'))),
    Situation('2.29 its own parent', World([DRIVER, Sender('/imu', ['tool tool'])]),
              [Lookup('odom', 'tool', ['loop'], ("Transforms of 'tool'", 'own parent'))],
              ['loop', 'several_trees'],
              [{'senders': [DRIVER, Sender('/imu', ['base_link tool'])]}]),
    Situation('2.31 a stamp just ahead of the data', World([DRIVER]),
              [Lookup('odom', 'base_link', ['too_soon'], ('timeout= of more than 0.1',), at=0.02),
               Lookup('odom', 'base_link', ['too_soon'], ('timeout= of more than 0.3',), at=0.02,
                      waited=0.3)], after=[{'at': None}]),
    Situation('2.32 a Buffer without a listener', World([DRIVER], has_listener=False),
              [Lookup('odom', 'base_link', ['no_listener'], ('TransformListener',))],
              after=[{'has_listener': True}]),
    Situation('2.36 NTP sets the clock back', World([
        DRIVER._replace(offset=30.0, end=-10.0), DRIVER._replace(begin=-9.9)]),
        [Lookup('odom', 'base_link', ['time_goes_back'], ('were refused', 'Clear the buffer'),
                at=-0.5)], finds=['other_clock', 'time_goes_back'],
        after=[{'senders': [DRIVER._replace(begin=-9.9)]}]),
    Situation('1.12 map -> odom on /tf, the rest on /robot1/tf', World([
        SLAM, DRIVER._replace(topic='/robot1/tf'),
        LASER._replace(topic='/robot1/tf_static')]),
        [Lookup('map', 'base_link', ['half_namespace'],
                ("'odom' -> 'base_link' is published on /robot1/tf by /driver", 'Remap both'))],
        after=[ROBOT, {'topics': ('/robot1/tf_static', '/robot1/tf'), 'senders': [
            each._replace(topic=f'/robot1{each.topic}') for each in (SLAM, DRIVER, LASER)]}]),
    Situation('a part of the middle is in a namespace, and there are scans', World(
        [SLAM, Sender('/driver', ['odom base_link', 'base_link arm'], topic='/robot1/tf'), LASER],
        sensors=[Sensor(), Sensor('/hand', '/force', 'arm')]), [], ['half_namespace']),
    Situation('1.11 all TF is in a namespace', World([DRIVER._replace(topic='/a300/tf')]),
              [Lookup('odom', 'base_link', ['other_namespace'],
                      ("tf_topic='/a300/tf'", '-r /tf:=/a300/tf -r /tf_static:=/a300/tf_static'))],
              after=[{'topics': ('/a300/tf_static', '/a300/tf')}, ROBOT]),
    Situation('1.18 the clock of the robot is 90 s behind', World([DRIVER._replace(offset=-90.0)]),
              [Lookup('odom', 'base_link', ['other_clock'], ('90.0 s behind',), at=0.0)],
              after=[AGAIN]),
    Situation('1.18 the clock of the robot is 5 s behind', World([DRIVER._replace(offset=-5.0)]),
              [Lookup('odom', 'base_link', ['other_clock'], ('5.0 s behind',), at=0.0)],
              ['late'], [AGAIN],
        report=['warning late: base_link',
                '401 of 401 transforms of base_link with stamps up to 5.0 s behind the arrival.']),
    Situation('1.17 the same, and a lookup at the present time', World([
        Sender('/rosbag2_player', ['odom base_link'], offset=-1e8)]),
        [Lookup('odom', 'base_link', ['other_clock'], ('Play the bag with --clock',), at=0.0)],
        after=[{'clock': NOW / S - 1e8, 'clock_nodes': ['/rosbag2_player']}],
        report=['Play the bag with --clock, and set use_sim_time.']),
    Situation('an old time in a simulation', World(
        [DRIVER._replace(offset=1000.0 - NOW / S)], clock=1000.0, clock_nodes=['/gazebo']),
        [Lookup('odom', 'base_link', ['cache_too_short'], at=-100.0),
         Lookup('odom', 'base_link', ['too_soon'], at=2.0)]),
    Situation('samples at 1 Hz, near the end of the cache', World([DRIVER._replace(rate=1.0)]),
              [Lookup('odom', 'base_link', ['cache_too_short'], at=-11.5)]),
    Situation('1.17 a bag is played without --clock', World([DRIVER._replace(offset=-1e8)]),
              [Lookup('odom', 'base_link', ['too_soon'], ('behind the clock of this node',),
                      at=-1e8 + 0.05)], ['other_clock'],
              [{'clock': NOW / S - 1e8, 'clock_nodes': ['/rosbag2_player'], 'at': 0.0}]),
    Situation('1.40 use_sim_time, and nothing on /clock', World([DRIVER], clock=0.0),
              [Lookup('odom', 'base_link', ['no_clock'], ('nothing publishes /clock',), at=5.0)],
              after=[{'clock': None, 'at': 0.0}, {**AGAIN, 'senders': [SIM_DRIVER], **SIM}]),
    Situation('1.30 two nodes publish /clock', World(
        [DRIVER], clock=NOW / S, clock_nodes=['/a', '/b']),
        [Lookup('odom', 'base_link', ['two_clocks'], ('/a, /b',), at=0.5)],
        after=[{'clock_nodes': ['/a'], 'at': 0.0}],
        report=['/a (400 messages), /b (400 messages) publish /clock, with the last times ']),
    Situation('a simulation, and a node without use_sim_time', World(
        [DRIVER._replace(offset=100.0 - NOW / S)], clock_nodes=['/gazebo']),
        [Lookup('odom', 'base_link', ['other_clock'],
                ('behind the clock of this node. Set use_sim_time in all nodes',), at=0.0)],
        after=[SIM, {'senders': [DRIVER]}],
        report=['error other_clock: base_link',
                'up to 1699999900.0 s (near 0, as since power-on) behind the arrival; the last '
                'stamp is 100.000000000.']),
    Situation('a simulation, and a driver without use_sim_time', World(
        [DRIVER], **SIM, use_sim_time={'/driver': False, '/nav': True}),
        [Lookup('odom', 'base_link', ['other_clock'],
                ('ahead of the clock of this node. Set use_sim_time in all nodes',), at=0.0)],
        ['use_sim_time_differs'],
        after=[{'senders': [SIM_DRIVER], 'use_sim_time': {'/driver': True, '/nav': True}},
               {'clock': None, 'clock_nodes': (), 'use_sim_time': {'/driver': False}}],
        report=['error use_sim_time_differs: /driver',
                'false in /driver, and true in /nav, while /gazebo publishes /clock.']),
    Situation('a node with use_sim_time looks up the wall time', World(
        [DRIVER._replace(offset=100.0 - NOW / S)], clock=100.0, clock_nodes=['/gazebo']),
        [Lookup('odom', 'base_link', ['message_other_clock'], (
            'That time is 1699999900.0 s ahead of', 'Set use_sim_time in all nodes'),
                at=NOW / S - 100.0)], finds=[], after=[{'at': 0.0}]),
    Situation('1.22 the node that looks up broadcasts', World(
        [DRIVER._replace(end=-0.05)], has_gids=True, node='/driver', blocked={'/driver': Blocked(
            'cannot while nothing spins it', 'Spin it in a thread.', ())}),
        [Lookup('odom', 'base_link', ['executor_blocked'],
                ('by this node, which cannot', 'Spin it in a thread.'), at=0.02,
                waited=0.01),
         Lookup('odom', 'tool', ['executor_blocked'], ('Nobody publishes on /tf but this node',),
                waited=0.01)]),
    Situation('a node that nobody spins has sent static transforms only', World(
        [Sender('/driver', ['base_link laser'], topic='/tf_static', rate=0.0)], has_gids=True,
        node='/driver', blocked={'/driver': Blocked(
            'cannot while nothing spins it', 'Spin it in a thread.', ())}),
        [Lookup('base_link', 'camera', [], ('does not exist',), waited=0.01)]),
    Situation('a publisher has ended', World(
        [DRIVER._replace(end=-5.0, has_ended=True)], has_gids=True),
        [Lookup('odom', 'base_link', ['gap'],
                ('/driver, which has published it, has ended', 'Start /driver again'), at=0.0)],
        after=[AGAIN], report=['20.0 Hz before; /driver has ended.', 'Start /driver again.']),
    Situation('a publisher is silent', World([DRIVER._replace(end=-5.0)], has_gids=True),
              [Lookup('odom', 'base_link', [], ('5.0 s ago. Publisher: /driver.',), at=0.0)],
        finds=['gap'], after=[AGAIN], report=['20.0 Hz before.', 'Look at the node']),
    Situation('the network of the listener is gone', World([
        SLAM._replace(end=-5.0), DRIVER._replace(end=-5.0), LASER], has_gids=True), [],
        ['listener_busy'], [ROBOT],
        ['warning listener_busy: odom, base_link',
         'nothing has arrived from any of 2 nodes in the last 5 s.']),
    Situation('a frame was sent once on /tf', World([DRIVER._replace(rate=0)]),
              [Lookup('odom', 'base_link', ['one_shot'], ('Only one has arrived, ',),
                      at=0.0)], after=[AGAIN, {'senders': [DRIVER._replace(
                          rate=0, topic='/tf_static')]}],
        report=['warning one_shot: base_link', 'one transform of base_link in 20 s.']),
    Situation('a stamp that never advances', World([DRIVER._replace(stamp=lambda _: NOW), SLAM]),
              [Lookup('map', 'base_link', ['frozen_stamp'], ('have this stamp',), at=-0.5)],
              after=[ROBOT, {'senders': [SLAM, DRIVER._replace(rate=0, topic='/tf_static')]}],
        report=['error frozen_stamp: base_link',
                '401 of 401 transforms of base_link with a stamp that stands, at 1700000000.',
                '000000000 for 20 s.']),
    Situation('a wrong type', World([DRIVER._replace(type='geometry_msgs/msg/TransformStamped')]),
              [Lookup('odom', 'base_link', ['wrong_type'], ('/driver publishes geometry_msgs',))],
              after=[AGAIN]),
    Situation('2.29 an empty parent', World([DRIVER, Sender('/imu', [' tool'])]),
              [Lookup('odom', 'tool', ['empty_name'], ('the other name is empty',))],
              after=[{'senders': [DRIVER, Sender('/imu', ['base_link tool'])]}],
        report=['warning empty_name: tool',
                '401 transforms with an empty frame_id or child_frame_id.']),
    Situation('a volatile listener', World([DRIVER], is_volatile=True),
              [Lookup('odom', 'laser', ['volatile_listener'], ('Omit static_qos',))],
              after=[{'is_volatile': False, **ROBOT}]),
    Situation('nobody publishes', World([]),
              [Lookup('odom', 'base_link', ['no_transforms'],
                      ('0 publishers on /tf and /tf_static were found in ROS domain ',))],
              after=[AGAIN]),
    Situation('joint states, and no robot_state_publisher', World(
        [], joint_states={'/joint_states': ['/driver']}),
        [Lookup('odom', 'base_link', ['no_transforms'],
                ('/joint_states has a publisher',))],
        after=[{'senders': [Sender('/rsp', ['odom base_link'])]}]),
    Situation('2.33 a listener that has just started', World([], is_new=True),
              [Lookup('odom', 'base_link', [], ('has just started',))], finds=['no_transforms']),
    Situation('a publisher that has sent nothing yet', World([Sender('/arm')], other_user='me'),
              [Lookup('odom', 'base_link', [], ('Nothing has arrived yet from /arm.',))],
        finds=['no_transforms']),
    Situation('2.35 a static whose program has ended', World([DRIVER]),
              [Lookup('odom', 'laser', [], ("Known frames: 'base_link', 'odom'",))]),
    Situation('a typo, beside nodes that wait', World([
        DRIVER, Sender('/rsp', waits_for='/joint_states'), Sender('/amcl', waits_for='/clock')]),
        [Lookup('odom', 'base_lnik', [], ("Nearest known: 'base_link'",))],
        ['no_clock', 'joint_without_state']),
    Situation('another name, where all joints are fixed', World([
        DRIVER, Sender('/rsp', ['base_link laser'], 0, '/tf_static', waits_for='/joint_states')]),
        [Lookup('odom', 'camera', ['joint_without_state'], ('If a joint moves the frame',))], []),
    Situation('a node with simulated time whose transforms have the stamps of messages', World([
        DRIVER._replace(waits_for='/clock')]),
        [Lookup('odom', 'camera', [], ("Known frames: 'base_link', 'odom'",))]),
    Situation('two trees, and no sign why', World([DRIVER, Sender('/lamp', ['world lamp'])]),
              [Lookup('odom', 'lamp', [], ("'lamp' in the tree with root 'world'",
                                           'tf_doctor odom lamp'), not_words=['Publish'])],
        finds=['several_trees'], after=[{'senders': [
            DRIVER, Sender('/lamp', ['world lamp']), Sender('/me', ['world odom'])]}]),
    Situation('an old time', World([DRIVER]),
              [Lookup('odom', 'base_link', ['cache_too_short'], ('of 12 s to the buffer',),
                      at=-11.0)],
              after=[{'cache_time': 12 * S}, {'at': -9.0}]),
    Situation('a time before all that was received', World([DRIVER._replace(begin=-3.0)]),
              [Lookup('odom', 'base_link', [], ('No earlier transform was received',), at=-5.0)]),
    Situation('2.13 the same, and a description of the robot', World(
        [DRIVER, Sender('/rsp', waits_for='/joint_states')],
        joint_states={'/robot1/joint_states': ['/arm']}, robots=[Robot(
            '/robot_description', '', 'base', ['base', 'hand'], {'turn': ['hand']}, {},
            ['/robot1/joint_states'])]), [], ['joint_without_state']),
    *(Situation(f'{row} {name}', World([DRIVER, LASER], robots=[arm(**{state: why})]), [],
                ['joint_without_state'], [{
                    'senders': [DRIVER, LASER, Sender('/rsp', ['base_link hand'])],
                    'robots': [arm(turn='')]}])
      for row, name, state, why in (
          ('2.14', 'a joint name with a prefix', 'x/turn', ''),
          ('2.14', 'a joint name with a suffix', 'turn_mimic', ''),
          ('2.15', 'joint states without positions', 'turn', 'have no positions'),
          ('2.15', 'joint states without a stamp', 'turn', 'have the stamp 0'))),
    Situation('2.17 a floating joint that nobody sends', World([DRIVER], robots=[Robot(
        '/robot_description', '', 'world', ['world', 'drone'], floating={'world', 'drone'})]),
        [Lookup('odom', 'drone', [], ("Known frames: 'base_link', 'odom'",))],
        ['link_without_transform'],
        [{'senders': [DRIVER, Sender('/mocap', ['odom world', 'world drone'])]}]),
    Situation('2.27 microseconds in nanosec', World([DRIVER._replace(
        nanosec=lambda stamp: stamp % S // 1000)]), [], ['nanosec'], [AGAIN]),
    Situation('2.27 milliseconds in nanosec', World([DRIVER._replace(
        nanosec=lambda stamp: stamp % S // 1_000_000)]), [], ['nanosec'], [AGAIN]),
    Situation('a cache of weeks is no remedy', World([DRIVER]),
              [Lookup('odom', 'base_link', [], (), at=-604_801.5, not_words=['cache_time'])]),
    Situation('2.30 /clock at 5 Hz', World(
        [SIM_DRIVER], **SIM, clock_rate=5.0), [Lookup('odom', 'base_link', None, at=-0.01)],
        ['slow_clock'], [{'clock_rate': 100.0}],
        report=['info slow_clock',
                '/gazebo publishes /clock at 5.0 Hz: stamps are up to 0.2 s ahead of it.']),
    Situation('2.45 a slash in headers', World([DRIVER, LASER], sensors=[Sensor(frame='/laser')]),
              [], ['leading_slash'], [{'sensors': [Sensor()]}],
        report=['warning leading_slash: /laser', "the headers on /scan name '/laser'."]),
    Situation('2.45 the same node is started twice', World([DRIVER, DRIVER]), [],
              ['two_publishers'], [AGAIN]),
    Situation('2.46 a localiser is 0.2 s late', World([
        SLAM._replace(takes=lambda _: 0.2), DRIVER]),
        [Lookup('map', 'base_link', ['too_soon'],
                ("edge 'map' -> 'odom'", 'timeout= of more than 0.2 s'), at=0.0, waited=0.1)],
        [], [{'at': None}]),
    Situation('2.46 the scoped name of Gazebo in a scan', World(
        [DRIVER, LASER], sensors=[Sensor(frame='robot/base_link/laser')]), [],
        ['unknown_frame'], [{'sensors': [Sensor()]}],
        report=['error unknown_frame: robot/base_link/laser',
                'is in the headers on /scan, but not among the 3 frames of the transforms. ']),
    Situation('1.14 one transform of the old run arrives after a reset', World([
        SIM_DRIVER._replace(begin=-4.0),
        Sender('/old', ['odom base_link'], 0, offset=190.0 - NOW / S, begin=-3.9)], **SIM),
        [Lookup('odom', 'base_link', ['time_goes_back'], ('Clear the buffer',), at=0.0)],
        ['time_goes_back', 'two_publishers'], [{'senders': [SIM_DRIVER]}],
        report=['1 of 82 transforms of base_link with an earlier stamp than the one before; the',
                ' from 186.100000000; a buffer with the', 'refuses 78 transforms.',
                'On /tf, by /driver, /old.']),
    Situation('1.24 a calibration changes', World([DRIVER, Sender(
        '/calibration', ['base_link camera'], 1.0, '/tf_static', pose=moves)]),
        [Lookup('odom', 'camera', None)], ['static_changes'], [{'senders': [DRIVER, Sender(
            '/calibration', ['base_link camera'], 1.0, pose=moves)]}],
        report=['info static_changes: camera',
                '20 of 21 transforms of camera with another pose than the one before.']),
    Situation('1.29 joint_state_publisher beside the driver', World(
        [DRIVER, LASER, Sender('/rsp', ['base_link hand'], pose=lambda i: moves(i % 2 * 100))],
        joint_states={'/joint_states': ['/driver', '/gui']}, robots=[arm(turn='')]), [],
        ['two_joint_publishers'], report=[
            '/driver (2 messages), /gui (2 messages) send turn on /joint_states.'], after=[{
            'senders': [DRIVER, LASER, Sender('/rsp', ['base_link hand'], pose=moves)],
            'joint_states': {'/joint_states': ['/driver']}}]),
    Situation('1.38 two sources of odom -> base_link, one with another clock', World([
        DRIVER, Sender('/robot2/ekf', ['odom base_link'], offset=-100.0)], has_gids=True),
        [Lookup('odom', 'base_link', ['time_goes_back'],
                ('from /robot2/ekf were refused', 'let only one node send'), at=-100.0)],
        ['two_publishers', 'other_clock'], [AGAIN]),
    Situation('a frame on both topics', World([
        DRIVER, Sender('/rsp', ['odom base_link'], 0, '/tf_static')]), [],
        ['static_and_dynamic'], [AGAIN]),
    Situation('headers of two trees', World(
        [DRIVER, LASER, Sender('/lamp', ['world lamp'])],
        sensors=[Sensor(), Sensor('/lamp', '/light', 'lamp')]), [],
        ['disconnected', 'several_trees'], [{'senders': [
            DRIVER, LASER, Sender('/lamp', ['world lamp']), Sender('/me', ['world odom'])]}],
        report=['error disconnected: lamp, laser',
                'headers use frames of 2 trees: lamp on /light; laser on /scan.']),
    Situation('a frame has stopped, and scans wait for it', World(
        [SLAM, DRIVER._replace(end=-8.0), LASER], sensors=[Sensor()]), [],
        ['gap', 'message_never'], [ROBOT]),
    Situation('scans wait for odometry', World(
        [DRIVER._replace(takes=lambda _: 0.3), LASER], sensors=[Sensor()]), [],
        ['message_early'], [ROBOT],
        report=['warning message_early: laser',
                '195 of 195 messages on /scan wait 0.1 s or more for the edge odom -> base_link ',
                'of /driver, up to 0.28 s, the first at ',
                'timeout=Duration(seconds=0.3) in the lookup; queue of a filter: ',
                'queue_size=3, ...). Or make the publisher send the transforms sooner, or']),
    Situation('some scans are ahead, and the others wait 30 ms', World(
        [DRIVER._replace(takes=lambda _: 0.05), LASER], sensors=[
            Sensor(stamp=lambda time: time + S // 5 * (-12 * S < time - NOW < -8 * S))]), [],
        ['message_early'], [{'sensors': [Sensor()]}],
        report=['39 of 199 messages on /scan wait 0.1 s or more for the edge odom -> base_link']),
    Situation('scans without a stamp', World(
        [DRIVER, LASER], sensors=[Sensor(stamp=lambda _: 0)]), [],
        ['message_zero_stamp'], [{'sensors': [Sensor()]}],
        report=['warning message_zero_stamp: laser',
                '200 of 200 messages on /scan have the stamp 0.']),
    Situation('a wrong measurement', World([
        DRIVER._replace(pose=lambda i: moves(i + 900 * (i == 200)))]), [],
        ['jump'], [{'senders': [DRIVER._replace(pose=moves)]}]),
    Situation('several poses with one stamp', World([
        DRIVER._replace(pose=moves, stamp=lambda stamp: stamp // (S // 5) * (S // 5))]), [],
        ['same_stamp'], [{'senders': [DRIVER._replace(pose=moves)]}],
        report=['warning same_stamp: base_link',
                '300 of 401 transforms of base_link with the stamp of the one before, and ']),
    Situation('a link that nobody sends', World([DRIVER], robots=[Robot(
        '/robot_description', '', 'base_link', ['base_link', 'laser'])]), [],
        ['link_without_transform'], [ROBOT]),
    Situation('a paused simulation', World(
        [SIM_DRIVER._replace(stamp=lambda _: 100 * S)], **SIM, speed=0.0), [],
        ['clock_stands'], [{'senders': [SIM_DRIVER], 'speed': 1.0}],
        report=['warning clock_stands',
                'the time on /clock of /gazebo has stood for 20.0 s.']),
    Situation('an EKF in the time zone of India, and scans', World(
        [DRIVER._replace(offset=19800.0), SLAM, LASER], sensors=[Sensor()]), [], ['other_clock']),
    Situation('a localiser whose clock is 25 s ahead', World(
        [DRIVER, LASER, SLAM._replace(offset=25.0)], sensors=[Sensor()]), [], ['other_clock']),
    Situation('a frame at 0.2 Hz, and scans', World(
        [DRIVER, LASER, Sender('/navsat', ['utm odom'], 0.2, begin=-24.0, end=-4.0)],
        sensors=[Sensor()]), [], ['message_early']),
    Situation('a frame was sent once on /tf, and images of it', World(
        [DRIVER, Sender('/s', ['base_link cam'], 0, begin=-12.0)], sensors=[Sensor(frame='cam')]),
        [], ['one_shot']),
    Situation('a localiser that is 3 s late stops, and scans', World(
        [DRIVER, LASER, SLAM._replace(offset=-3.0, end=-8.0)], sensors=[Sensor()]), [],
        ['message_never', 'gap', 'message_early', 'late']),
    Situation('a controller starts again, and begins at 0', World([DRIVER._replace(
        rate=30.0, stamp=lambda time: time - NOW + (900 if time < NOW - 6 * S else 6) * S)]), [],
        ['other_clock', 'time_goes_back']),
    Situation('a clock is set forward by 40 s', World([DRIVER._replace(
        stamp=lambda time: time - 40 * S * (time < NOW - 8 * S)), LASER], sensors=[Sensor()]), [],
        ['other_clock']),
    Situation('a camera repeats its last stamp', World([DRIVER, Sender(
        '/cam', ['base_link cam'], stamp=lambda time: min(time, NOW - 12 * S))], sensors=[Sensor(
            frame='cam')]), [], ['frozen_stamp']),
    Situation('a stamp stood for a while', World([DRIVER._replace(stamp=lambda time: (
        NOW - 15 * S if -15 * S <= time - NOW < -10 * S else time))]), [], ['frozen_stamp']),
    Situation('a backlog grows, and is dropped', World([DRIVER._replace(stamp=lambda time: (
        time - (time - NOW + 20 * S) // 2 if time < NOW - 4 * S else time))]), [],
        ['gap', 'late']),
    Situation('a GPS clock finds satellites, and steps to GPS time', World([DRIVER._replace(
        stamp=lambda time: time + 18 * S * (time >= NOW - 8 * S)), LASER], sensors=[Sensor()]),
        [], ['other_clock']),
    Situation('a node crashes and starts again', World([DRIVER._replace(
        begin=-20.0 + 2 * k, end=-18.8 + 2 * k, has_ended=k < 9) for k in range(10)]), [],
        ['many_publishers']),
    Situation('a node creates a broadcaster in each callback, and sends nothing', World(
        [Sender('/arm')] * 30), [], ['many_publishers']),
    Situation('two nodes send a static transform of one frame', World([
        Sender('/rsp', ['base arm', 'world table'], 0, '/tf_static', begin=-9.0),
        Sender('/a', ['arm camera'], 0, '/tf_static', begin=-8.0),
        Sender('/b', ['table camera'], 0, '/tf_static', begin=-7.0)]),
        [Lookup('base', 'camera', ['changing_parent'], ("'arm' (static) by /a", 'by /b'))]),
    Situation('two static transforms that differ by 15 mm', World([DRIVER, LASER, LASER._replace(
        node='/camera', pose=lambda _: (0.015, *STILL[1:]))]), [], ['two_publishers']),
    *(Situation(f'a scan on {topic} in the frame {frame}', World([DRIVER, LASER], sensors=[
        Sensor(topic=topic, frame=frame)]), [], ['unknown_frame'])
      for topic, frame in (('/scan', 'lidar_link'), ('/lasr', 'lasr'))),
    Situation('a topic has the name of a link of the robot', World([DRIVER, LASER], sensors=[
        Sensor(topic='/tip', frame='tip')], robots=[Robot(
            '/robot_description', '', 'base_link', ['base_link', 'tip'])]), [],
        ['unknown_frame', 'link_without_transform']),
    Situation('whole seconds', World([DRIVER._replace(stamp=lambda time: time // S * S)]), [],
              ['nanosec']),
    Situation('a driver stops for 6 s, and scans go on', World([DRIVER._replace(
        is_lost=lambda i: 200 < i < 320), LASER], sensors=[Sensor()]), [], ['gap']),
    Situation('a slow driver stops for 6 s, and scans go on', World([DRIVER._replace(
        is_lost=lambda i: 200 < i < 320, takes=lambda _: 0.3), LASER], sensors=[Sensor()]), [],
        ['gap', 'message_early'], report=['of /driver, up to 0.28 s, the first at ']),
    Situation('a driver stops for 6 s, and scans wait for another one', World([
        DRIVER._replace(is_lost=lambda i: 200 < i < 320), LASER,
        SLAM._replace(takes=lambda _: 0.3)], sensors=[Sensor()]), [],
        ['gap', 'message_early'], report=['the edge map -> odom of /slam, up to 0.28 s']),
    Situation('the stamps of a driver are 0.3 s ahead, and scans are in time', World(
        [DRIVER._replace(offset=0.3), LASER], sensors=[Sensor()]), [], ['future'],
        report=['with stamps up to 0.3 s ahead of the arrival.']),
    Situation('a bag with --clock, and a camera of now', World([
        Sender('/rosbag2_player', ['odom base_link'], offset=100.0 - NOW / S),
        Sender('/camera', ['base_link cam'])], clock=100.0, clock_nodes=['/rosbag2_player'],
        use_sim_time={'/rosbag2_player': False, '/camera': False, '/nav': True}), [],
        ['use_sim_time_differs'], report=['use_sim_time is false in /camera, and true in /nav']),
    Situation('two lidars on one topic, one of them on GPS time', World(
        [DRIVER, LASER], sensors=[Sensor(stamp=lambda time: time + time // (S // 10) % 2 * 18 * S)
    ]),
        [], ['message_never', 'message_early'],
        report=['Correct the clock that stamps the messages.']),
    Situation('a lidar repeats its last stamp', World([DRIVER, LASER], sensors=[
        Sensor(stamp=lambda time: min(time, NOW - 15 * S))]), [], ['message_too_old'],
        report=['On /scan, by /lidar.\n    More: ']),
    Situation('a second parent comes now and then', World([
        DRIVER, Sender('/scene', ['odom box']), Sender('/grip', ['base_link box'], 0.3)]), [],
        ['changing_parent']),
]

#: Lookups that engineers thought of who had not seen the rules.
THOUGHT_OF = [
    Situation('a suffix on some frames only', World(
        [DRIVER, Sender('/cad', ['base laser'], 0, '/tf_static')]),
        [Lookup('odom', 'laser', ['part_prefix'], ("'base_link' and 'base'",))]),
    Situation('the network has been late for 4 s', World(
        [DRIVER._replace(rate=50.0, takes=lambda number: 4.0 * (number >= 800)), LASER]),
        [Lookup('odom', 'laser', ['too_soon'], ('4.0 s behind',), at=0.0)]),
    Situation('an old transform after a reset', World(
        [Sender('/gz', ['odom base_link'], 50.0, begin=-4.9, stamp=lambda time: 300 * S if (
            time == NOW - 49 * S // 10) else time - NOW + 5 * S), LASER],
        clock_nodes=['/gz'], clock=5.0, has_gids=True),
        [Lookup('odom', 'laser', ['time_goes_back'], ('refused (245)',), at=-0.1)]),
    *(Situation(f'{unit} as nanoseconds', World(
        [DRIVER._replace(stamp=ns.__rfloordiv__)]),
        [Lookup('odom', 'base_link', ['other_clock'], (f'{unit} as nanoseconds',), at=0.0)])
      for unit, ns in (('microseconds', 1000), ('milliseconds', 10**6), ('seconds', S))),
    Situation('a slow simulation', World(
        [DRIVER._replace(stamp=lambda time: (time - NOW) // 5 + 300 * S), Sender(
            '/slam', ['map odom'], 0.2, begin=-18.0, end=-3.0,
            stamp=lambda time: (time - NOW) // 5 + 300 * S)],
        clock_nodes=['/gz'], clock=300.0, speed=0.2),
        [Lookup('map', 'base_link', at=-0.02, not_words=['ahead'])]),
    Situation('two fixes were missed', World(
        [DRIVER, Sender('/navsat', ['utm odom'], 0.2, begin=-32.0, end=-12.0)]),
        [Lookup('utm', 'base_link', [], ('Publishers on /tf: /driver, /navsat.',), at=0.0)]),
    Situation('a publisher has ended, and gids are not known', World([
        DRIVER._replace(end=-5.0, has_ended=True)]),
        [Lookup('odom', 'base_link', [], ('Publishers on /tf: none.',), at=0.0)]),
    Situation('a driver whose clock is 90 s behind has ended', World([
        DRIVER._replace(offset=-90.0, end=-5.0, has_ended=True)], has_gids=True),
        [Lookup('odom', 'base_link', ['gap'], at=0.0)]),
    Situation('what publishes /clock has ended, and transforms arrive', World(
        [SIM_DRIVER], clock=100.0), [Lookup('odom', 'base_link', ['too_soon'], at=0.02)]),
    Situation('two nodes publish /clock, and this one does not use it', World(
        [DRIVER], clock_nodes=['/a', '/b']),
        [Lookup('odom', 'base_link', ['cache_too_short'], at=-11.0)]),
    Situation('the clock of this node keeps no frame away', World([DRIVER], clock=0.0),
              [Lookup('map', 'base_link')]),
    Situation('a best-effort publisher of another frame', World([
        DRIVER, Sender('/wheels', ['base_link wheel'], lacks='reliable')]),
        [Lookup('map', 'base_link'), Lookup('odom', 'wheel', ['incompatible_qos'])]),
    Situation('a micro-controller has started again', World([DRIVER._replace(
        stamp=lambda time: time - NOW + (900 if time < NOW - 6 * S else 6) * S), LASER]),
        [Lookup('odom', 'laser', ['other_clock'], ('near 0',), at=0.0)]),
    Situation('the map of another robot', World([DRIVER, LASER, *(
        Sender('/r2', [edge], topic='/r2/tf') for edge in ('map odom', 'odom base_link'))]),
        [Lookup('map', 'laser', ['half_namespace'], not_words=['To listen'])]),
    Situation('a node was away for a while', World([
        DRIVER._replace(begin=-60.0, end=-30.0, has_ended=True), DRIVER._replace(begin=-4.0)],
        has_gids=True), [Lookup('odom', 'base_link', [], at=-5.0, not_words=['max_samples'])]),
    Situation('a localiser has started again', World([
        AMCL._replace(end=-5.0, has_ended=True), Sender('/amcl'), DRIVER], has_gids=True),
        [Lookup('odom', 'map', [], ('5.0 s ago',), at=0.5, not_words=['Start /amcl'])]),
    Situation('all have been refused for 3 s', World([
        DRIVER, Sender('/imu', ['base_link imu'], end=-3.0),
        Sender('/imu', ['base_link imu'], begin=-2.9, pose=lambda _: (0.0,) * 7)]),
        [Lookup('odom', 'imu', ['unnormalized'], ('refused (59)',), at=0.0)]),
    Situation('a node repeats its last stamp', World([
        SLAM._replace(stamp=lambda time: min(time, NOW - 5 * S)), DRIVER]),
        [Lookup('map', 'base_link', [], ('has not advanced for 5.0 s',), at=0.0)]),
    Situation('an edge at 0.1 Hz', World([
        Sender('/gps', ['map odom'], 0.1, begin=-62.0, end=-2.0), DRIVER]),
        [Lookup('map', 'base_link', ['too_soon'], ('timeout= of more than 8.0 s',), at=0.0)]),
    Situation('a message from before a reset', World(
        [DRIVER._replace(offset=100.0 - NOW / S), LASER], clock=100.0, clock_nodes=['/gazebo']),
        [Lookup('odom', 'laser', ['message_other_clock'], ('45.0 s ahead of',), at=45.0)]),
    Situation('poses that are computed late', World([
        Sender('/rtabmap', ['map odom'], 1.0, offset=-4.0), DRIVER]),
        [Lookup('map', 'base_link', ['other_clock'], ('If this is not on purpose',), at=0.0)]),
    Situation('a simulation without /clock', World([
        DRIVER._replace(offset=100.0 - NOW / S), LASER]),
        [Lookup('odom', 'laser', ['other_clock'], ('If they are simulated, publish /clock',),
                at=0.0)]),
    Situation('a bag is played in a loop', World([
        Sender('/rosbag2_player', ['odom base_link'], offset=-1000.0, begin=-70.0, end=-10.0),
        Sender('/rosbag2_player', ['odom base_link'], offset=-1060.0, begin=-9.9)]),
        [Lookup('odom', 'base_link', ['time_goes_back'], ('Play the bag with --clock',),
                at=-1060.0)]),
    Situation('one node of a simulation has no use_sim_time', World([
        Sender('/gazebo', ['odom base_link'], 30, offset=100.0 - NOW / S),
        Sender('/ekf', ['odom base_link'], begin=-19.99), LASER], has_gids=True, clock=100.0,
        clock_nodes=['/gazebo']),
        [Lookup('odom', 'laser', ['time_goes_back'],
                ('from /ekf is newer', 'Set use_sim_time in all nodes'), at=0.0)]),
    Situation('a bag has the map only, and the clock of the driver is behind', World([
        DRIVER._replace(offset=-90.0), Sender('/rosbag2_player', ['world map'], 0, '/tf_static')]),
        [Lookup('odom', 'base_link', ['other_clock'], ('synchronise the clocks',), at=0.0)]),
    Situation('the simulation has crashed', World([
        DRIVER._replace(offset=100.0 - NOW / S, end=-10.0), LASER], clock=90.0, has_gids=True),
        [Lookup('odom', 'laser', ['no_clock'], ('nothing publishes /clock',), at=0.05)]),
]


def robot(name, topic='/tf'):
    """Return the publishers of a whole robot with a prefix."""
    return [Sender(f'/{name}/driver', [f'{name}/odom {name}/base_link'], topic=topic),
            Sender(f'/{name}/rsp', [f'{name}/base_link {name}/laser'], 0, f'{topic}_static')]


def simulated(speed, begin=20.0, rate=20.0):
    """Return a simulation at some speed, in which it is `begin` (s) now."""
    driver = DRIVER._replace(rate=rate, begin=-min(20.0, begin / speed), stamp=lambda time: round(
        begin * S + (time - NOW) * speed))
    return [driver, LASER], {'clock': begin, 'clock_nodes': ['/clock_source'], 'speed': speed,
                     'use_sim_time': {'/driver': True}, 'sensors': [Sensor(begin=-5.0)]}


#: Situations in which nothing is wrong: their publishers, and other arguments of `World`.
WELL = [
    ('a robot, and its scans', [SLAM, DRIVER, LASER], {'sensors': [Sensor()]}),
    ("AMCL's transform_tolerance, and scans", [SLAM._replace(offset=0.5), DRIVER, LASER], {
        'sensors': [Sensor()]}),
    ('robot_state_publisher with fixed joints only', [DRIVER, LASER, Sender('/rsp')], {}),
    ('robot_state_publisher without fixed joints', [
        Sender('/rsp', ['base_link arm', 'arm hand']), Sender('/rsp', topic='/tf_static')], {}),
    ('a static transform that is sent each second', [DRIVER, LASER._replace(rate=1.0)], {}),
    ('slow localisation', [SLAM._replace(rate=1.0), DRIVER, LASER], {'sensors': [Sensor(
        frame='map')]}),
    ('Wi-Fi that loses a third', [
        DRIVER._replace(is_lost=lambda i: i * 7919 % 31 % 3 == 0), LASER], {}),
    ('Wi-Fi with jitter', [DRIVER._replace(takes=lambda i: i * 7919 % 31 / 700), LASER], {}),
    ('a robot whose clock is 0.3 s behind', [DRIVER._replace(offset=-0.3), LASER], {}),
    ('a robot whose clock is 0.05 s ahead', [DRIVER._replace(offset=0.05), LASER], {}),
    ('GPS once a second, on the second', [
        DRIVER, Sender('/gps', ['earth map'], 1.0, stamp=lambda time: time // S * S)], {}),
    ('bursts of ten at the begin of each second', [Sender('/bursts', ['map tag'], 10.0, is_lost=(
        lambda i: i % 10 > 0))], {}),
    ('a rare frame', [DRIVER, Sender('/tag', ['base_link tag'], 0.3)], {}),
    ('two robots and their scans', [*robot('robot1'), *robot('robot2')], {'sensors': [
        Sensor(f'/{name}/lidar', f'/{name}/scan', f'{name}/laser')
        for name in ('robot1', 'robot2')]}),
    ('another robot on topics of its own', [
        SLAM, DRIVER, LASER, *(each._replace(topic=f'/r{each.topic}')
                               for each in (SLAM, DRIVER, LASER))], {}),
    ('two robots on topics of their own, and one map', [
        *(Sender(f'/{name}/slam', ['map odom', 'odom base_link'], topic=f'/{name}/tf')
          for name in ('r1', 'r2'))], {'topics': ('/r1/tf_static', '/r1/tf')}),
    ('a node that is started again', [
        DRIVER._replace(end=-10.0, has_ended=True), DRIVER._replace(begin=-9.8)], {}),
    ('a gripper takes a cup and puts it back', [
        Sender('/scene', ['world table', 'world hand']), *(
            Sender(f'/{name}', [f'{name} cup'], begin=begin, end=begin + 5.9) for name, begin in (
                ('table', -18.0), ('hand', -12.0), ('table', -6.0)))], {}),
    ('a node hands a frame over to another one', [
        DRIVER, Sender('/perception', ['odom box'], 10, end=-10.0),
        Sender('/gripper', ['base_link box'], 10, begin=-10.0)], {}),
    ('a scene publishes a cup, but not while it is held', [
        Sender('/scene', ['world hand', 'world table']),
        Sender('/table', ['table cup'], is_lost=lambda i: 100 < i < 200),
        Sender('/grip', ['hand cup'], begin=-14.9, end=-10.1)], {}),
    ('two robots whose frames have numbers, and their scans', [
        Sender(f'/e{i}', [f'odom_{i} base_{i}']) for i in (1, 2)], {'sensors': [
            Sensor(f'/l{i}', f'/scan_{i}', f'base_{i}') for i in (1, 2)]}),
    ('a joystick', [DRIVER, LASER], {'sensors': [Sensor('/joy_node', '/joy', 'joy')]}),
    ('markers in the root at the latest time', [SLAM, DRIVER], {'sensors': [
        Sensor('/viz', '/markers', 'map', stamp=lambda _: 0)]}),
    ('a simulation beside the robot', [DRIVER, LASER], {
        'clock_nodes': ['/twin'], 'use_sim_time': {'/twin': True, '/driver': False}}),
    ('robot_state_publisher is started again with another description', [
        DRIVER, LASER._replace(has_ended=True), Sender(
            '/rsp', ['base_link mast', 'mast laser'], 0, '/tf_static', begin=-5.0)], {}),
    ('boxes on a belt', [Sender('/tracker', [f'belt box_{i}'], 10, begin=6.0 * i - 18.0,
                                end=6.0 * i - 14.0) for i in range(3)], {}),
    ('recording is paused', [
        DRIVER._replace(is_lost=lambda i: 200 < i < 320),
        SLAM._replace(is_lost=lambda i: 100 < i < 160)], {}),
    ('a busy computer', [
        DRIVER._replace(is_lost=lambda i: 200 < i < 218 or 230 < i < 240), LASER],
        {'late': [(NOW + (i - 400) * S // 20, S // 50) for i in range(190, 250)]}),
    ('a network that was away for 4 s', [
        DRIVER._replace(takes=lambda i: (280 - i) / 20 if 200 < i < 280 else 0.0),
        SLAM._replace(takes=lambda i: (140 - i) / 10 if 100 < i < 140 else 0.0)], {}),
    ('two nodes send an equal static transform', [
        DRIVER, LASER, LASER._replace(node='/camera')], {}),
    ('an image that takes 0.3 s', [DRIVER, LASER], {'sensors': [Sensor(takes=0.3)]}),
    ('joint states, whose frame is empty', [DRIVER, LASER], {'sensors': [Sensor(frame='')]}),
    ('a rare message', [DRIVER, LASER], {'sensors': [Sensor(rate=0.5)]}),
    ('a floating joint that a localiser sends', [Sender('/mocap', ['world drone'])], {'robots': [
        Robot('/robot_description', '', 'world', ['world', 'drone'], floating={'drone'})]}),
    ('2.1 a simulation', *simulated(1.0)),
    ('a simulation that has just begun', *simulated(1.0, 4.0)),
    ('a slow simulation', *simulated(0.3, rate=10.0)),
    ('a bag at 0.1 of its speed', *simulated(0.1, 1000.0)),
    ('a bag at 10 times its speed', *simulated(10.0, 1000.0, 100.0)),
]

#: Lookups whose error must name no cause, or another one than one could think.
UNLUCKY = [
    Situation('a node calibrates a camera, and moves it in the tree', World([
        Sender('/rsp', ['base arm', 'world table'], 0, '/tf_static', begin=-9.0),
        Sender('/calibration', ['arm camera'], 0, '/tf_static', begin=-8.0),
        Sender('/calibration', ['table camera'], 0, '/tf_static', begin=-7.0)]),
        [Lookup('base', 'camera', [])]),
    Situation('a program whose node is not known', World([Sender('unknown publisher')]),
              [Lookup('odom', 'base_link', [], (
                  'Nothing has arrived yet from a publisher whose node is not known.',))]),
    Situation('a typo beside other faults', World([
        DRIVER, LASER, Sender('/viz', ['map m'], lacks='reliable'), Sender('/x', type='A')]),
        [Lookup('odom', 'lasr', [], ("'laser'",))]),
    Situation('an almost equal name within a tree, and one in a third tree', World([
        DRIVER, Sender('/rsp', ['odom Odom', 'Odom tool']), Sender('/lamp', ['world lamp']),
        Sender('/drone', ['map World'])]), [Lookup('tool', 'lamp', [])]),
    Situation('a drone beside a robot', World([
        DRIVER, Sender('/drone', ['world drone_base_link'])]),
        [Lookup('odom', 'drone_base_link', [])]),
    Situation('a map server', World([SLAM, DRIVER, Sender(
        '/tiles', ['map_server tile0'], 0, '/tf_static')]), [Lookup('odom', 'tile0', [])]),
    Situation('a part is handed over to another robot', World([
        Sender('/r1', ['r1/odom r1/base']), Sender('/r2', ['r2/odom r2/base']),
        Sender('/t1', ['r1/base part'], end=-5.0), Sender('/t2', ['r2/base part'], begin=-4.9)],
        has_gids=True), [Lookup('r1/base', 'part', [])]),
    Situation('both hold it for a moment', World([
        Sender('/scene', ['world table', 'world hand']), Sender('/a', ['table cup'], end=-4.8),
        Sender('/b', ['hand cup'], begin=-4.99)], has_gids=True),
        [Lookup('world', 'cup', ['cache_too_short'], at=-11.0)]),
    Situation('a time after those of the transforms that are refused', World([
        SIM_DRIVER._replace(begin=-4.0),
        Sender('/old', ['odom base_link'], 0, offset=190.0 - NOW / S, begin=-3.9)], **SIM),
        [Lookup('odom', 'base_link', ['cache_too_short'], at=30.0)]),
    Situation('a slow node that has just begun', World([
        Sender('/loc', ['map odom'], 0, begin=-1.5), DRIVER]),
        [Lookup('map', 'base_link', [], at=0.0, not_words=['again and again'])]),
]

HEALTHY = [
    Situation('an arm that listens to commands, and a frame that does not exist', World([
        Sender('/dummy_arm', ['base_link joint_1'], waits_for='/dummy_arm/joint_command')]),
        [Lookup('base_link', 'tool', [], not_words=['joint_command'])]),
    Situation('a clock is set back by 0.1 s', World([DRIVER._replace(
        stamp=lambda stamp: stamp - (stamp > NOW - 10 * S) * S // 10)]),
        [Lookup('odom', 'base_link', None)]),
    Situation('2.23 map -> odom is dated ahead on purpose', World(
        [SLAM._replace(offset=1.0), DRIVER, LASER]), [Lookup('map', 'laser', None, at=-0.1)]),
    Situation('two robots with full prefixes, and one map', World([
        Sender(f'/robot{i}/rsp', [f'map robot{i}/odom', f'robot{i}/odom robot{i}/base_link'])
        for i in (1, 2)]), [Lookup('robot1/base_link', 'robot2/base_link', None)]),
    Situation('two robots beside each other', World([
        Sender(f'/robot{i}/rsp', [f'robot{i}/odom robot{i}/base_link']) for i in (1, 2)]),
        [Lookup('robot1/base_link', 'robot2/base_link', [], not_words=['prefix'])]),
    Situation('a robot without a prefix beside one with it', World([
        Sender('/a', ['map odom', 'odom base_link', 'base_link laser']),
        Sender('/b', ['b/map b/odom', 'b/odom b/base_link'])]),
        [Lookup('laser', 'b/base_link', [], not_words=['prefix'])]),
    Situation('a gripper takes an object', World([
        Sender('/scene', ['world table', 'world arm', 'arm hand']),
        Sender('/a', ['table cup'], end=-5.0), Sender('/b', ['hand cup'], begin=-4.9)]),
        [Lookup('table', 'cup', None), Lookup('world', 'cup', ['too_soon'], at=0.02)]),
    *(Situation(name, World(senders, **world), []) for name, senders, world in WELL),
]

#: By row that is not here: the test of what it says.
ELSEWHERE = {
    '1.1': 'ros/test_point_cloud2.py::test_points_of_any_layout',
    '1.2': 'unit/test_transform_buffer.py::test_clear_forgets_what_moves',
    '1.3': 'unit/test_tf2_answers.py::test_answers_as_tf2',
    '1.4': 'ros/test_wrong_types.py::test_a_duration_as_the_time',
    '1.5': 'unit/test_insertion.py::test_a_rotation_is_normalised_with_the_sign_of_tf2',
    '1.6': 'unit/test_tf_transformations.py::test_rotation',
    '1.7': 'ros/test_geometry.py::test_a_pose_with_covariance',
    '1.8': 'ros/test_wrong_types.py::test_a_type_that_no_function_transforms',
    '1.9': 'commands/test_static_transform_publisher.py::test_new_style',
    '1.10': 'commands/test_tf2_echo.py::test_the_rate',
    '1.13': 'ros/test_buffer.py::test_a_clock_that_jumps_back_clears_the_buffer',
    '1.15': 'commands/test_robot_state_publisher.py::test_a_late_state_after_a_reset_of_the_clock',
    '1.16': 'unit/test_robot_transforms.py::test_a_publisher_whose_clock_jumps_ahead_is_believed',
    '1.19': 'ros/test_message_filter.py::test_over_dds_while_the_listener_inserts',
    '1.20': 'long/test_transform_listener.py::test_every_order_of_ending',
    '1.21': 'ros/test_transform_listener.py::test_a_lookup_waits_inside_a_callback',
    '1.23': 'ros/test_message_filter.py::test_it_ends',
    '1.25': 'unit/test_tf_trajectory.py::test_a_static_pose_at_the_stamps_of_a_topic',
    '1.26': 'unit/test_bag.py::test_a_bag_without_tf',
    '1.27': 'unit/test_transform_buffer.py::test_the_yaml_of_odd_names_can_be_read',
    '1.31': 'commands/test_robot_state_publisher.py::test_the_command_that_an_error_names_works',
    '1.32': 'commands/test_robot_state_publisher.py::test_arguments_and_parameters',
    '1.33': 'ros/test_wrong_types.py::test_a_field_of_a_wrong_type',
    '1.34': 'ros/test_wrong_types.py::test_a_transform_of_rosbags',
    '1.35': 'ros/test_buffer.py::test_an_abandoned_wait_leaves_nothing_behind',
    '1.37': 'commands/test_tf2_monitor.py::test_sim_time_that_is_set_back',
    '1.39': 'unit/test_doctor.py::test_the_ends_of_the_data_can_be_typed',
    '1.41': 'unit/test_explanations.py::test_a_time_in_seconds_is_told',
    '1.42': 'unit/test_transform_buffer.py::test_large_coordinates',
    '2.16': 'unit/test_robot_transforms.py::test_answers_are_those_of_the_real_one',
    '2.20': 'unit/test_doctor.py::test_cases',
    '2.34': 'ros/test_transform_listener.py::test_a_listener_that_nobody_holds_goes_on',
    '2.37': 'ros/test_buffer.py::test_a_clock_that_jumps_back_clears_the_buffer',
    '2.38': 'ros/test_transform_listener.py::test_async_waits_end_while_the_node_is_spun',
    '2.39': 'ros/test_contexts.py::test_two_contexts',
    '2.40': 'ros/test_transform_broadcaster.py::test_statics_accumulate',
    '2.41': 'unit/test_tree_properties.py::test_answers_as_the_model',
    '2.42': 'unit/test_transform.py::test_the_matrix_of_a_composition_is_the_product',
    '2.43': 'commands/test_static_transform_publisher.py::test_old_style',
    '2.44': 'unit/test_bag.py::test_publishers_of_ros1',
}
#: By code: the test in which a remedy, or another one of its remedies, is executed.
REMEDIES = {
    'other_user': 'commands/test_tf_doctor.py::test_a_healthy_arm',
    'executor_blocked':
        'ros/test_hints.py::test_a_lookup_that_blocks_the_broadcaster_of_its_node',
    'half_namespace': 'commands/test_tf_doctor.py::test_half_a_namespace',
    'many_publishers': 'commands/test_tf_doctor.py::test_a_healthy_arm',
    'missing_part': 'unit/test_doctor.py::test_a_missing_part',
    'stamps_in_seconds': 'unit/test_explanations.py::test_stamps_in_seconds_are_told',
    'time_in_seconds': 'unit/test_transform_buffer.py::test_the_hint_of_an_error',
    'time_is_duration': 'ros/test_buffer.py::test_a_lookup_waits_for_the_data',
    'too_soon': 'unit/test_transform_buffer.py::test_waits_for_data_from_another_thread',
}
