"""
Attack everything that listens to TF in a ROS domain, from a process of its own.

    bad_peers.py ATTACK SECONDS

ATTACK is the name of a function at the end of this file; its docstring says what it does. First,
the program waits until it is connected to what listens, and prints 'attacking'. At the end, it
prints 'sent N', the number of messages. SIGALRM ends it if it hangs, and it ends early if its
parent does.
"""

from itertools import count, islice
import os
import random
import signal
import subprocess
import sys
import time

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from puretf import TFMessage
from puretf._core.pose import Row
from puretf._wire import cdr
from puretf._wire.encoding import CDR

S = 10**9
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
#: What `fight` says joint_2 to be.
WRONG_PARENT, WRONG_PLACE = 'bad_parent', (0.4, 5.0, 0.0)
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
NAN, INF = float('nan'), float('inf')
#: The longest time until the attack begins, and also that by which it may take longer (s).
_PATIENCE = 60
#: At least this number of processes listens to /tf in the tests.
_LISTENERS = 5


class Peer:
    """A node that attacks for a limited time."""

    def __init__(self, seconds):
        """Create the node; after much more than the time, SIGALRM ends the process."""
        signal.alarm(int(seconds) + 2 * _PATIENCE)
        rclpy.init()
        self.seconds, self.sent = seconds, 0
        self.node = rclpy.create_node('bad_peer')

    def connect(self, topic, qos=100, listeners=_LISTENERS):
        """Return a function that publishes bytes on a topic, when others listen to it."""
        publisher = self.node.create_publisher(TFMessage, topic, qos)
        deadline = time.monotonic() + _PATIENCE
        while publisher.get_subscription_count() < listeners:
            if time.monotonic() > deadline:
                sys.exit(f'{publisher.get_subscription_count()} listen to {topic}')
            time.sleep(0.01)
        return publisher.publish

    def rounds(self, hertz):
        """
        Yield 0, 1, … at a rate, until the time is over or the parent has ended.

        Where the computer is busy, it takes longer than this time: at least a third of the
        messages are sent.
        """
        parent, begin = os.getppid(), time.monotonic()
        print('attacking', flush=True)
        for number in count():
            is_over = time.monotonic() - begin > self.seconds and number > hertz * self.seconds / 3
            if is_over or os.getppid() != parent:
                return
            yield number
            # A peer that is late does not sleep.
            time.sleep(max(0.0, begin + (number + 1) / hertz - time.monotonic()))


def packed(*edges, stamp=None, pose=STILL):
    """Return the bytes of a message with a transform for each pair (parent, child)."""
    return cdr.pack(Row(stamp or time.time_ns(), parent, child, pose) for parent, child in edges)


def garbage(peer):
    """
    Publish what is no TFMessage, and transforms that make no sense, 2000 messages/s.

    Random bytes, messages cut off or with some bytes changed, and wrong counts and lengths; NaN,
    infinite numbers and quaternions without length; empty names, names that are only a slash,
    frames that are their own parents, and loops.
    """
    chance = random.Random(22)
    good = packed(('bad_a', 'bad_b'), ('bad_b', 'bad_c'))
    senseless = [packed(*edges, pose=pose) for edges, pose in (
        ([('bad_a', 'bad_nan')], (NAN,) * 7), ([('bad_a', 'bad_inf')], (INF, -INF, *STILL[2:])),
        ([('bad_a', 'bad_zero')], (0.0,) * 7), ([('bad_a', 'bad_huge')], (1e308,) * 7),
        ([('', 'bad_b'), ('bad_a', ''), ('/', 'bad_b'), ('bad_a', '/')], STILL),
        ([('bad_own', 'bad_own')], STILL),
        ([('bad_1', 'bad_2'), ('bad_2', 'bad_3'), ('bad_3', 'bad_1')], STILL), ([], STILL))]
    topics = [peer.connect('/tf'), peer.connect('/tf_static', LATCHED)]
    for _ in peer.rounds(250):
        at = chance.randrange(4, len(good))
        for data in (
                chance.randbytes(chance.randrange(4, 300)),
                good[:4] + chance.randbytes(chance.randrange(300)), good[:at],
                good[:at] + chance.randbytes(4) + good[at + 4:],
                good[:4] + b'\xff\xff\xff\x7f' + good[8:],
                good[:16] + b'\xff\xff\xff\xff' + good[20:], *chance.sample(senseless, 2)):
            chance.choice(topics)(data)
            peer.sent += 1


def other_type(peer):
    """Publish and request texts on /tf and /tf_static, by ever new endpoints, 200 messages/s."""
    for _ in peer.rounds(50):
        endpoints = []
        for topic, qos in ('/tf', 100), ('/tf_static', LATCHED):
            publisher = peer.node.create_publisher(String, topic, qos)
            endpoints += [publisher, peer.node.create_subscription(String, topic, print, qos)]
            for _ in range(2):
                publisher.publish(String(data='map -> base_link'))
                peer.sent += 1
        time.sleep(0.01)
        for destroy, endpoint in zip([peer.node.destroy_publisher,
                                      peer.node.destroy_subscription] * 2, endpoints):
            destroy(endpoint)


def flood(peer):
    """
    Publish 20 000 messages/s, each with one transform of one of 100 frames.

    One process cannot send that many, so it starts another one, for `half_a_flood`.
    """
    with subprocess.Popen([sys.executable, __file__, 'half_a_flood', str(peer.seconds)],
                          stdout=subprocess.PIPE, text=True) as other:
        half_a_flood(peer)
        assert other.stdout is not None
        peer.sent += int(other.stdout.read().split()[-1])


def half_a_flood(peer):
    """Publish 10 000 messages/s; see `flood`."""
    publish = peer.connect('/tf')
    messages = [packed(('bad_root', f'bad_{i}')) for i in range(100)]
    for _ in peer.rounds(100):
        stamp = packed(('', ''))[8:16]  # the rest of the bytes stays the same
        for data in messages:
            publish(data[:8] + stamp + data[16:])
            peer.sent += 1


def names(peer):
    """Publish 50 000 frames with new names in all, 100 in each message."""
    publish = peer.connect('/tf')
    for number in islice(peer.rounds(500 / peer.seconds), 500):
        publish(packed(*(
            ('bad_root', f'bad_{os.getpid()}_{number}_{i}') for i in range(100))))
        peer.sent += 1


def parents(peer):
    """Publish one frame with ever new parents, 50 messages/s with 100 parents each."""
    publish = peer.connect('/tf')
    for number in peer.rounds(50):
        now = time.time_ns()
        publish(cdr.pack(Row(now + i, f'bad_{os.getpid()}_{number}_{i}', 'bad_child', STILL)
                         for i in range(100)))
        peer.sent += 1


def time_jumps(peer):
    """Publish frames below the arm, and /clock, with times that jump by 1000 s, 300 messages/s."""
    publish = peer.connect('/tf')
    clock = peer.node.create_publisher(Clock, '/clock', 10)
    for number in peer.rounds(100):
        for jump in 0, 1000, -1000:
            now = time.time_ns() + jump * S
            publish(packed(('end_effector', 'bad_jumping'), ('map', f'bad_{number % 3}'),
                           stamp=now))
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(now, S)
            clock.publish(message)
            peer.sent += 1


def fight(peer):
    """Repeat each message of the arm with another pose of joint_2, or with another parent."""
    publish = peer.connect('/tf')
    stamps: list[int] = []

    def note(data):
        stamps.extend(row.stamp_ns for row in CDR.unpack(data) if row.child_frame_id == 'joint_3')

    peer.node.create_subscription(TFMessage, '/tf', note, 100, raw=True)
    for _ in peer.rounds(500):
        rclpy.spin_once(peer.node, timeout_sec=0)
        for stamp in stamps:
            publish(packed(('joint_1', 'joint_2'), stamp=stamp, pose=(*WRONG_PLACE, *STILL[3:]))
                    if peer.sent % 7 else packed((WRONG_PARENT, 'joint_2'), stamp=stamp))
            peer.sent += 1
        stamps.clear()


def volatile_static(peer):
    """
    Offer and request QoS that fits nobody, with ever new publishers and subscriptions.

    A volatile publisher on /tf_static says that base_link is elsewhere; a subscription wants
    latched messages on /tf.
    """
    for _ in peer.rounds(50):
        publisher = peer.node.create_publisher(TFMessage, '/tf_static', 100)
        publisher.publish(packed(('map', 'base_link'), pose=(9.0, *STILL[1:])))
        subscription = peer.node.create_subscription(
            TFMessage, '/tf', lambda _: sys.exit('received TF'), LATCHED)
        peer.sent += 1
        time.sleep(0.01)
        peer.node.destroy_publisher(publisher)
        peer.node.destroy_subscription(subscription)


def long_names(peer):
    """Publish frames whose names have a million characters, ten on each topic per second."""
    topics = [peer.connect('/tf'), peer.connect('/tf_static', LATCHED)]
    for number in peer.rounds(10):
        name = f'bad_{number}_'.ljust(10**6, 'x')
        for publish in topics:
            publish(packed(('map', name)) if number % 2 else packed((name, 'bad_child')))
            peer.sent += 1


#: The attacks by name; those that leave many frames in a buffer come last.
ATTACKS = {attack.__name__: attack for attack in (
    flood, garbage, other_type, time_jumps, fight, volatile_static, long_names, parents, names)}


def main(attack, seconds):
    """Attack for a time."""
    peer = Peer(float(seconds))
    globals()[attack](peer)
    print(f'sent {peer.sent}', flush=True)


if __name__ == '__main__':
    main(*sys.argv[1:])
