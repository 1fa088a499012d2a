"""
Situations from public reports, as data, and the codes of their causes.

The numbers are those of the two logs from which they are: `2.5` is row 5 of the second one.
"""

from typing import NamedTuple

from world import Lookup, NOW, S, Sender, World

from puretf._causes.facts import Blocked


class Situation(NamedTuple):
    """A situation, and the lookups in it."""

    name: str
    world: World
    lookups: list[Lookup]


SCAN_OF_LIDAR = 'the clock of this node'
DRIVER = Sender('/driver', ['odom base_link'])
LASER = Sender('/rsp', ['base_link laser'], 0, '/tf_static')
AMCL = Sender('/amcl', ['map odom'], 10, offset=0.5)
SLAM = Sender('/slam', ['map odom'], 10)
#: A listener that has been there for a long time, and so has dropped transforms.
LONG = -20.0


def clock_off(offset: float, *causes: str, words: tuple[str, ...] = (), begin: float = LONG
              ) -> Situation:
    """Return a sensor whose stamps are off by some time (s), while all transforms are in time."""
    return Situation(
        f'2.19-25 a sensor is {offset} s off, {-begin} s after the start',
        World([DRIVER._replace(begin=begin), LASER._replace(begin=begin)]),
        [Lookup('odom', 'laser', causes, words, at=offset,
                not_words=('Skip', 'Set use_sim_time', 'publisher'))])


FAULTY = [
    Situation('2.2 static and dynamic parent', World([
        Sender('/rsp', ['base_footprint base_link', 'base_link laser'], 0, '/tf_static'), DRIVER]),
        [Lookup('base_footprint', 'base_link', ['changing_parent'],
                ("'base_link'", "'base_footprint' (static) by /rsp", "'odom' by /driver"),
                not_words=['Publish a transform'])]),
    Situation('2.3 the same, the other way round', World([
        Sender('/rsp', ['base_link base_footprint', 'base_link laser'], 0, '/tf_static'),
        Sender('/sim', ['odom base_footprint'])]),
        [Lookup('odom', 'laser', ['changing_parent'],
                ("'base_footprint'", "'base_link' (static) by /rsp", "'odom' by /sim"))]),
    Situation('2.4 two dynamic parents that alternate', World([
        DRIVER._replace(rate=30), Sender('/slam', ['map base_link'], 30, begin=-19.99,
                                         end=-0.01)]),
        [Lookup('map', 'base_link', ['changing_parent'],
                ("'map'", "'odom' by /driver", '/slam'))]),
    Situation('2.5 a part has a prefix', World([
        Sender('/controller', ['robot1/odom robot1/base_link']), SLAM, LASER]),
        [Lookup('map', 'laser', ['part_prefix'], ("'robot1/odom'", "'odom'"),
                not_words=['Publish a transform'])]),
    Situation('2.6 only odom has the prefix', World([
        Sender('/controller', ['robot1/odom base_link']), SLAM, LASER]),
        [Lookup('map', 'laser', ['part_prefix'], ("'robot1/odom'", "'odom'"))]),
    Situation('2.6 a prefix without a slash', World([
        Sender('/controller', ['odom robot1base_link']), SLAM, LASER]),
        [Lookup('map', 'laser', ['part_prefix'], ("'robot1base_link'", "'base_link'"))]),
    Situation('2.6 odom_combined', World([
        Sender('/controller', ['odom_combined base_link']), SLAM, LASER]),
        [Lookup('map', 'laser', ['part_prefix'], ("'odom_combined'", "'odom'"))]),
    Situation('2.7, 1.28 names that differ by case or a blank', World([
        Sender('/controller', ['Odom base_link']), SLAM]),
        [Lookup('map', 'base_link', ['similar_name'], ('differ by case',))]),
    Situation('2.8 a localiser before its first pose', World([DRIVER, Sender('/amcl')]),
              [Lookup('map', 'base_link', ['silent_publisher'],
                      ('/amcl has a publisher on /tf', 'nothing arrives'))]),
    Situation('2.9 a publisher waits for /clock', World([
        Sender('/odom_node', waits_for='/clock')]), [Lookup('odom', 'base_link', ['no_clock'],
                      ('/odom_node waits for /clock, which nothing publishes',
                       'use_sim_time'))]),
    Situation('2.11 a bag is played with a start offset', World([
        Sender('/rosbag2_player', ['odom base_link']),
        Sender('/rosbag2_player', topic='/tf_static')]),
        [Lookup('odom', 'laser', ['silent_publisher'],
                ('/rosbag2_player has sent nothing on /tf_static', 'start offset'))]),
    Situation('2.12 volatile statics', World([DRIVER, LASER._replace(lacks='transient local')]),
              [Lookup('odom', 'laser', ['static_not_latched'], ('/rsp', 'not transient local'))]),
    Situation('1.36 best effort', World([DRIVER._replace(lacks='reliable'), LASER]),
              [Lookup('odom', 'laser', ['incompatible_qos'], ('/driver', 'not reliable'))]),
    Situation('2.13 joint states on another topic', World(
        [LASER, Sender('/robot_state_publisher', waits_for='/joint_states')],
        joint_states={'/robot1/joint_states': ['/driver']}),
        [Lookup('base_link', 'arm', ['joint_without_state'],
                ('/robot_state_publisher waits for /joint_states', '/robot1/joint_states',
                 '/driver', '-r /joint_states:=/robot1/joint_states'))]),
    *(clock_off(offset, 'message_other_clock', words=(word, SCAN_OF_LIDAR), begin=begin)
      for offset, word in ((-37.0, 'TAI'), (37.0, 'TAI'), (18.0, 'GPS'), (-18.1, 'GPS'),
                           (-28800.0, '8 hours'), (7200.0, '2 hours'),
                           (-315_964_782.0, 'GPS epoch'), (1868.0 - NOW / S, 'power-on'))
      for begin in (-3.0, LONG)),
    clock_off(4.0, 'message_other_clock', words=('4.0 s ahead of the clock of this node',)),
    clock_off(-12.3, 'cache_too_short', words=('cache_time=14 s',)),
    clock_off(-12.3, begin=-3.0, words=('No earlier transform was received',)),
    Situation('2.26 data ahead of the clock', World([DRIVER._replace(offset=30.0)]),
              [Lookup('odom', 'base_link', ['other_clock'], ('30.0 s ahead of it',), at=0.0)]),
    *(Situation(f'2.28 refused: {code}', World([DRIVER, Sender(
        '/imu', ['base_link tool'], pose=pose)], has_gids=True),
        [Lookup('odom', 'tool', [code], ("transforms of 'tool' from /imu were refused",))])
      for code, pose in (('not_a_number', (float('nan'), *[0.0] * 5, 1.0)),
                         ('unnormalized', (0.0,) * 7))),
    Situation('2.29 its own parent', World([DRIVER, Sender('/imu', ['tool tool'])]),
              [Lookup('odom', 'tool', ['loop'], ("transforms of 'tool'", 'own parent'))]),
    Situation('2.31 a stamp just ahead of the data', World([DRIVER]),
              [Lookup('odom', 'base_link', ['too_soon'], ('Pass timeout=',), at=0.02),
               Lookup('odom', 'base_link', ['too_soon'], ('has not come within 0.01 s',), at=0.02,
                      waited=0.01)]),
    Situation('2.32 a Buffer without a listener', World([DRIVER], has_listener=False),
              [Lookup('odom', 'base_link', ['no_listener'], ('TransformListener',))]),
    Situation('2.36 NTP sets the clock back', World([
        DRIVER._replace(offset=30.0, end=-10.0), DRIVER._replace(begin=-9.9)]),
        [Lookup('odom', 'base_link', ['time_goes_back'], ('were refused', 'Clear the buffer'),
                at=-0.5)]),
    Situation('1.12 map -> odom on /tf, the rest on /robot1/tf', World([
        SLAM, DRIVER._replace(topic='/robot1/tf'),
        LASER._replace(topic='/robot1/tf_static')]),
        [Lookup('map', 'base_link', ['half_namespace'],
                ("'odom' -> 'base_link' is published on /robot1/tf by /driver", 'Remap both'))]),
    Situation('1.11 all TF is in a namespace', World([DRIVER._replace(topic='/a300/tf')]),
              [Lookup('odom', 'base_link', ['other_namespace'],
                      ('/a300/tf', '--namespace a300'))]),
    Situation('1.18 the clock of the robot is 90 s behind', World([DRIVER._replace(offset=-90.0)]),
              [Lookup('odom', 'base_link', ['other_clock'], ('90.0 s behind it',), at=0.0)]),
    Situation('1.18 the clock of the robot is 5 s behind', World([DRIVER._replace(offset=-5.0)]),
              [Lookup('odom', 'base_link', ['other_clock'], ('5.0 s behind it',), at=0.0)]),
    Situation('1.17 the same, and a lookup at the present time', World([
        Sender('/rosbag2_player', ['odom base_link'], offset=-1e8)]),
        [Lookup('odom', 'base_link', ['other_clock'], ('Play the bag with --clock',), at=0.0)]),
    Situation('an old time in a simulation', World(
        [DRIVER._replace(offset=1000.0 - NOW / S)], clock=1000.0, clock_nodes=['/gazebo']),
        [Lookup('odom', 'base_link', ['cache_too_short'], at=-100.0),
         Lookup('odom', 'base_link', ['too_soon'], at=2.0)]),
    Situation('samples at 1 Hz, near the end of the cache', World([DRIVER._replace(rate=1.0)]),
              [Lookup('odom', 'base_link', ['cache_too_short'], at=-11.5)]),
    Situation('1.17 a bag is played without --clock', World([DRIVER._replace(offset=-1e8)]),
              [Lookup('odom', 'base_link', ['too_soon'], ('behind the clock of this node',),
                      at=-1e8 + 0.05)]),
    Situation('1.40 use_sim_time, and nothing on /clock', World([DRIVER], clock=0.0),
              [Lookup('odom', 'base_link', ['no_clock'], ('nothing publishes /clock',), at=5.0)]),
    Situation('1.30 two nodes publish /clock', World(
        [DRIVER], clock=NOW / S, clock_nodes=['/a', '/b']),
        [Lookup('odom', 'base_link', ['two_clocks'], ('/a, /b',), at=0.5)]),
    Situation('a simulation, and a node without use_sim_time', World(
        [DRIVER._replace(offset=100.0 - NOW / S)], clock_nodes=['/gazebo']),
        [Lookup('odom', 'base_link', ['use_sim_time_differs'],
                ('the data are not', '/gazebo publishes /clock'), at=0.0)]),
    Situation('a node with use_sim_time looks up the wall time', World(
        [DRIVER._replace(offset=100.0 - NOW / S)], clock=100.0, clock_nodes=['/gazebo']),
        [Lookup('odom', 'base_link', ['use_sim_time_differs'], ('requested time is not',),
                at=NOW / S - 100.0)]),
    Situation('1.22 the node that looks up broadcasts', World(
        [DRIVER._replace(end=-0.05)], has_gids=True, node='/driver', blocked={'/driver': Blocked(
            'cannot while nothing spins it', 'Spin it in a thread.', ())}),
        [Lookup('odom', 'base_link', ['executor_blocked'],
                ('This node publishes it, and cannot', 'Spin it in a thread.'), at=0.02,
                waited=0.01),
         Lookup('odom', 'tool', ['executor_blocked'], ('Only this node publishes on /tf',),
                waited=0.01)]),
    Situation('a publisher has ended', World(
        [DRIVER._replace(end=-5.0, has_ended=True)], has_gids=True),
        [Lookup('odom', 'base_link', ['gap'],
                ('/driver, which has published it, has ended', 'Start /driver again'), at=0.0)]),
    Situation('a publisher is silent', World([DRIVER._replace(end=-5.0)], has_gids=True),
              [Lookup('odom', 'base_link', [], ('arrived 5.0 s ago from /driver',), at=0.0)]),
    Situation('a frame was sent once on /tf', World([DRIVER._replace(rate=0)]),
              [Lookup('odom', 'base_link', ['one_shot'], ('Only one has arrived, 20.0 s ago',),
                      at=0.0)]),
    Situation('a stamp that never advances', World([DRIVER._replace(stamp=lambda _: NOW), SLAM]),
              [Lookup('map', 'base_link', ['frozen_stamp'], ('have this stamp',), at=-0.5)]),
    Situation('a wrong type', World([DRIVER._replace(type='geometry_msgs/msg/TransformStamped')]),
              [Lookup('odom', 'base_link', ['wrong_type'], ('/driver publishes geometry_msgs',))]),
    Situation('2.29 an empty parent', World([DRIVER, Sender('/imu', [' tool'])]),
              [Lookup('odom', 'tool', ['empty_name'], ('the other name is empty',))]),
    Situation('a volatile listener', World([DRIVER], is_volatile=True),
              [Lookup('odom', 'laser', ['volatile_listener'], ('Omit static_qos',))]),
    Situation('nobody publishes', World([]),
              [Lookup('odom', 'base_link', ['no_transforms'],
                      ('0 publishers on /tf and /tf_static were found in ROS domain ',))]),
    Situation('joint states, and no robot_state_publisher', World(
        [], joint_states={'/joint_states': ['/driver']}),
        [Lookup('odom', 'base_link', ['no_robot_state_publisher'],
                ('/joint_states has a publisher',))]),
    Situation('a listener that has just started', World([], is_new=True),
              [Lookup('odom', 'base_link', [], ('has just started',))]),
    Situation('a publisher that has sent nothing yet', World([Sender('/arm')]),
              [Lookup('odom', 'base_link', [], ('Nothing has arrived yet from /arm.',))]),
    Situation('2.35 a static whose program has ended', World([DRIVER]),
              [Lookup('odom', 'laser', [], ("Known frames: 'base_link', 'odom'",))]),
    Situation('a typo, beside nodes that wait', World([
        DRIVER, Sender('/rsp', waits_for='/joint_states'), Sender('/amcl', waits_for='/clock')]),
        [Lookup('odom', 'base_lnik', [], ("Nearest known: 'base_link'",))]),
    Situation('another name, where all joints are fixed', World([
        DRIVER, Sender('/rsp', ['base_link laser'], 0, '/tf_static', waits_for='/joint_states')]),
        [Lookup('odom', 'camera', ['joint_without_state'], ('If a joint moves the frame',))]),
    Situation('a node with simulated time whose transforms have the stamps of messages', World([
        DRIVER._replace(waits_for='/clock')]),
        [Lookup('odom', 'camera', [], ("Known frames: 'base_link', 'odom'",))]),
    Situation('a typo', World([DRIVER]),
              [Lookup('odom', 'base_lnik', [], ("Nearest known: 'base_link'",))]),
    Situation('two trees, and no sign why', World([DRIVER, Sender('/lamp', ['world lamp'])]),
              [Lookup('odom', 'lamp', [], ("'lamp' in the tree with root 'world'",
                                           'tf_doctor odom lamp'), not_words=['Publish'])]),
    Situation('an old time', World([DRIVER]),
              [Lookup('odom', 'base_link', ['cache_too_short'], ('cache_time=',), at=-11.0)]),
    Situation('a time before all that was received', World([DRIVER._replace(begin=-3.0)]),
              [Lookup('odom', 'base_link', [], ('No earlier transform was received',), at=-5.0)]),
    Situation('a cache of weeks is no remedy', World([DRIVER]),
              [Lookup('odom', 'base_link', [], (), at=-604_801.5, not_words=['cache_time'])]),
]

#: What engineers thought of who had not seen the rules.
FAULTY += [
    Situation('the localiser has ended, and the latest pose is asked', World([
        AMCL._replace(begin=-60.0, end=-15.0, has_ended=True), DRIVER._replace(begin=-60.0),
        LASER], has_gids=True), [Lookup('map', 'laser', ['gap'], ('/amcl', 'Start /amcl again'))]),
    Situation('a node was away for a while', World([
        DRIVER._replace(begin=-60.0, end=-30.0, has_ended=True), DRIVER._replace(begin=-4.0)],
        has_gids=True), [Lookup('odom', 'base_link', [], at=-5.0, not_words=['max_samples'])]),
    Situation('a localiser has started again', World([
        AMCL._replace(end=-5.0, has_ended=True), Sender('/amcl'), DRIVER], has_gids=True),
        [Lookup('odom', 'map', [], ('5.0 s ago',), at=0.5, not_words=['Start /amcl'])]),
    Situation('all have been refused for 3 s', World([
        DRIVER, Sender('/imu', ['base_link imu'], end=-3.0),
        Sender('/imu', ['base_link imu'], begin=-2.9, pose=(0.0,) * 7)]),
        [Lookup('odom', 'imu', ['unnormalized'], ('59 transforms of',), at=0.0)]),
    Situation('a node repeats its last stamp', World([
        SLAM._replace(stamp=lambda time: min(time, NOW - 5 * S)), DRIVER]),
        [Lookup('map', 'base_link', [], ('has not advanced for 5.0 s',), at=0.0)]),
    Situation('an edge at 0.1 Hz', World([
        Sender('/gps', ['map odom'], 0.1, begin=-62.0, end=-2.0), DRIVER]),
        [Lookup('map', 'base_link', ['too_soon'], ('timeout= of more than 8.0 s',), at=0.0)]),
    Situation('a message from before a reset', World(
        [DRIVER._replace(offset=100.0 - NOW / S), LASER], clock=100.0, clock_nodes=['/gazebo']),
        [Lookup('odom', 'laser', ['message_other_clock'], ('45.0 s ahead of',), at=45.0)]),
    Situation('a bag with --clock, and a node without use_sim_time', World([
        Sender('/rosbag2_player', ['odom base_link'], offset=-30.0)],
        clock_nodes=['/rosbag2_player']),
        [Lookup('odom', 'base_link', ['other_clock'], ('Set use_sim_time in all',), at=0.0)]),
    Situation('poses that are computed late', World([
        Sender('/rtabmap', ['map odom'], 1.0, offset=-4.0), DRIVER]),
        [Lookup('map', 'base_link', ['other_clock'], ('If this is not on purpose',), at=0.0)]),
    Situation('stamps that were never set', World([DRIVER._replace(stamp=lambda _: 0), SLAM]),
              [Lookup('map', 'base_link', ['zero_stamp'], ('Set header.stamp',), at=-0.1)]),
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
        [Lookup('odom', 'laser', ['use_sim_time_differs'], ('the data are not',), at=0.0)]),
    Situation('the simulation has crashed', World([
        DRIVER._replace(offset=100.0 - NOW / S, end=-10.0), LASER], clock=90.0, has_gids=True),
        [Lookup('odom', 'laser', ['no_clock'], ('nothing publishes /clock any more',), at=0.05)]),
]

HEALTHY = [
    Situation('a typo beside other faults', World([
        DRIVER, LASER, Sender('/viz', ['map m'], lacks='reliable'), Sender('/x', type='A')]),
        [Lookup('odom', 'lasr', [], ("'laser'",))]),
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
    Situation('a slow node that has just begun', World([
        Sender('/loc', ['map odom'], 0, begin=-1.5), DRIVER]),
        [Lookup('map', 'base_link', [], at=0.0, not_words=['again and again'])]),
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
]
