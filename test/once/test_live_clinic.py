"""Situations of the clinic over real DDS, also after their remedies: the same causes."""

import json
import os
import signal
from tempfile import TemporaryDirectory
from time import monotonic, sleep, time_ns
from typing import Any

from cli_runner import call
from messages import written
from processes import ARM, TIMEOUT
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from situations import FAULTY, HEALTHY
from world import S, Sender

from puretf import Buffer, TFMessage, TransformException, TransformListener
from puretf._core.pose import Row
from puretf.publisher_listener import PublisherListener
from puretf_tools.commands import tf_doctor

#: Within a participant, a topic cannot have two types.
TYPES: dict[str, Any] = {'tf2_msgs/msg/TFMessage': TFMessage}
AS_IT_IS = Sender._field_defaults['stamp']


def is_live(situation):
    """Return whether a situation arises within some seconds, in one process."""
    world = situation.world
    return (bool(situation.lookups) and world.clock is None and world.has_listener
            and not (world.is_new or world.blocked or world.other_user or world.is_volatile)
            and not any(
                sender.has_ended or sender.end < 0.0 or sender.stamp is not AS_IT_IS
                or sender.type not in TYPES
                for sender in world.senders)
            and not any(lookup.waited or 'cache_too_short' in (lookup.causes or ())
                        for lookup in situation.lookups))


LIVE = [each for situation in FAULTY + HEALTHY for each in (situation, *situation.healed())
        if is_live(each)]


def message(sender: Sender, now: int) -> bytes:
    """Return the message that a sender sends now (ns)."""
    stamp = now + round(sender.offset * S)
    rows = [Row(stamp, parent, child, sender.pose(0)) for child, parent in sender.parents.items()]
    return written(rows, stamps=[(stamp // S, sender.nanosec(stamp))] * len(rows))


def running(world, make_node):
    """Let the senders of a world publish."""
    for sender in world.senders:
        namespace, _, name = sender.node.rpartition('/')
        node = make_node(name, namespace=namespace or '/', is_spun=True)
        publisher = node.create_publisher(TYPES[sender.type], sender.topic, QoSProfile(
            depth=100,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if sender.is_static and (
                sender.lacks != 'transient local') else DurabilityPolicy.VOLATILE,
            reliability=ReliabilityPolicy.BEST_EFFORT if sender.lacks == 'reliable' else
            ReliabilityPolicy.RELIABLE))
        if sender.waits_for:
            kind: Any = Clock if sender.waits_for == '/clock' else JointState
            node.create_subscription(kind, sender.waits_for, print, 10)
        if sender.edges:
            def send(publisher=publisher, sender=sender):
                publisher.publish(message(sender, time_ns()))
            send()
            if sender.rate:
                node.create_timer(1.0 / sender.rate, send)
    for topic, nodes in world.joint_states.items():
        for each in nodes:
            make_node(each.strip('/')).create_publisher(JointState, topic, 10)
    for each in world.clock_nodes:
        make_node(each.strip('/')).create_publisher(Clock, '/clock', 10)


@pytest.mark.parametrize('situation', LIVE, ids=lambda situation: situation.name)
def test_a_situation(ros, make_node, monkeypatch, situation):
    """Each lookup has its cause as soon as the data are there."""
    monkeypatch.setattr('puretf.transform_listener._DISCOVERY', 0.0)
    node = make_node('laptop', is_spun=True)
    buffer = Buffer(node=node)
    static, dynamic = situation.world.topics
    listener = (PublisherListener if situation.world.has_gids else TransformListener)(
        buffer, node, tf_topic=dynamic, tf_static_topic=static)

    def causes(lookup):
        time = 0 if lookup.at is None or lookup.causes is None else (
            time_ns() + round(lookup.at * S))
        try:
            buffer.lookup_transform(lookup.target, lookup.source, Time(nanoseconds=time))
        except TransformException as error:
            text = str(error)
            return error.causes if all(word in text for word in lookup.words) else text
        return None

    def is_right():
        return all(causes(lookup) == (None if lookup.causes is None else (*lookup.causes,))
                   for lookup in situation.lookups)

    running(situation.world, make_node)
    deadline = monotonic() + TIMEOUT
    with ros.spinning():
        while not is_right():
            assert monotonic() < deadline, [*map(causes, situation.lookups)]
            sleep(0.1)
    listener.unregister()


#: Becomes another user, who may read the files of python, and starts a program.
OTHER_USER = (
    'import os, sys\n'
    'ids, caps = "--reuid=65534 --regid=65534 --clear-groups", "+dac_read_search"\n'
    'os.execvp("setpriv", ["setpriv", *ids.split(), "--inh-caps", caps, "--ambient-caps", caps, '
    'sys.executable, *sys.argv[1:]])')


@pytest.mark.skipif(os.geteuid() != 0, reason='only root can start programs of another user')
def test_two_users_of_one_computer(start, domain_id):
    """Nothing arrives from the other one, who is named."""
    with TemporaryDirectory() as logs:  # those above tmp_path are closed to others
        os.chmod(logs, 0o777)
        arm = start('-c', OTHER_USER, *ARM, environment={'ROS_LOG_DIR': logs})
        arm.line_with('publishing')
        result = call(tf_doctor.main, '--json', domain=domain_id)
        arm.end(signal.SIGINT)
    assert [each['code'] for each in json.loads(result.stdout)['findings']] == ['other_user']
    assert 'nobody runs nodes' in result.stdout


def test_a_hundred_are_live():
    assert len(LIVE) >= 100
