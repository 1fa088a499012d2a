"""
Programs that listen to TF while a test attacks them or their surroundings.

    python attacked.py watch            print the pose of the arm's hand, until SIGINT
    python attacked.py create           create and destroy 500 listeners
    python attacked.py interrupt SEED   raise KeyboardInterrupt at random times

`watch` prints the pose of end_effector in map, if it is new: the stamp (ns), x, y, z (m), and the
angle about z (rad). `create` needs the arm, too; it prints what the process uses before and after
it. `interrupt` uses a buffer in the main thread, and checks the buffer after that.
"""

from collections import Counter
from contextlib import suppress
import gc
import json
from math import atan2
import os
from pathlib import Path
import random
import signal
import sys
import threading
import time
import weakref

from endings import print_unraisable
import rclpy
from rclpy.duration import Duration
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time
from ros_node import eventually, stamped

from puretf import (
    Buffer,
    LookupException,
    TransformBroadcaster,
    TransformException,
    TransformListener,
)
from puretf._core.engine import engine_of
from puretf_tools.cli.fast_dds import destroy

S = 10**9
LATEST = Time()
LONG = Duration(seconds=60)
#: How many interrupts are raised, and how many at least while each kind of work is done.
INTERRUPTS, OF_A_KIND = 2500, 10
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def ns(stamp):
    """Return a stamp in ns."""
    return stamp.sec * S + stamp.nanosec


def watch():
    """Print each new pose of the hand."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('watching')
    with suppress(KeyboardInterrupt):
        buffer = Buffer(node=node)
        TransformListener(buffer, node)
        print('ready')
        stamp = 0
        while True:
            with suppress(TransformException):
                found = buffer.lookup_transform(
                    'map', 'end_effector', LATEST, Duration(seconds=0.2))
                if ns(found.header.stamp) != stamp:
                    stamp = ns(found.header.stamp)
                    t, r = found.transform.translation, found.transform.rotation
                    print(stamp, t.x, t.y, t.z, 2 * atan2(r.z, r.w))
            time.sleep(0.1)
    destroy(node)


def figures():
    """Return the numbers of threads and descriptors, and the resident memory (MiB)."""
    gc.collect()
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return {'threads': len(os.listdir('/proc/self/task')),
            'descriptors': len(os.listdir('/proc/self/fd')),
            'MiB': round(pages * os.sysconf('SC_PAGE_SIZE') / 2**20, 1)}


def create():
    """
    Create and destroy listeners while messages arrive.

    Print as JSON: the figures after 100 listeners, after 400 more of the same node, and after 50
    with nodes of their own; and how many buffers and listeners are left.
    """
    rclpy.init()
    node = rclpy.create_node('creating')
    made: weakref.WeakSet[object] = weakref.WeakSet()

    def listen(node):
        buffer = Buffer(node=node)
        listener = TransformListener(buffer, node)
        made.update((buffer, listener))
        buffer.lookup_transform('map', 'end_effector', LATEST, LONG)
        return listener

    def listen_often(count):
        for _ in range(count):
            listen(node).unregister()
        return figures()

    def listen_with_nodes(count):
        for _ in range(count):
            own = rclpy.create_node('own')
            listen(own)
            own.destroy_node()
        return figures()

    print(json.dumps([listen_often(100), listen_often(400), listen_with_nodes(50), len(made)]))
    destroy(node)


class Interrupted:
    """A buffer that is used in the main thread, into which KeyboardInterrupts are raised."""

    def __init__(self, seed):
        """Start a listener, a thread that sends, and one that waits for what it sends."""
        self.random = random.Random(seed)
        self.node = rclpy.create_node('interrupted')
        self.buffer = Buffer(node=self.node)
        self.listener = TransformListener(self.buffer, self.node)
        self.broadcaster = TransformBroadcaster(self.node)
        self.number = 0  # of the last transform of 'sent'; its stamp is number ms, its x is number
        self.waited = 0  # how often the thread that waits got what it waited for
        self.inserted = 1
        self.has_waited, self.has_sent = threading.Event(), threading.Event()
        self.problems: list[str] = []
        self.insert()
        self.sender, self.waiter = (
            threading.Thread(target=each) for each in (self.send, self.wait))
        self.sender.start()
        self.waiter.start()

    def send(self):
        """Send a transform 200 times a second."""
        sender = TransformBroadcaster(self.node)
        while not self.has_sent.wait(0.005):
            self.number += 1
            sender.sendTransform(row_message('sent', self.number))

    def wait(self):
        """Wait for each twentieth transform, in a thread that nothing interrupts."""
        while not self.has_waited.is_set():
            after = self.number + 20
            try:
                self.check('sent', time_of(after), LONG)
            except Exception as error:
                self.problems.append(repr(error))
                return
            self.waited += 1

    def check(self, frame, when, timeout=None):
        """Look a transform up; its x must be that of its stamp."""
        found = self.buffer.lookup_transform('map', frame, when, timeout or Duration())
        # In place of a lost sample is one between its neighbours, with rounding errors.
        if abs(found.transform.translation.x * 10**6 - ns(found.header.stamp)) > 1.0:
            self.problems.append(f'{frame}: {found}')
        return found

    # What the main thread does

    def latest(self):
        """Look the latest transform up."""
        self.check('sent', LATEST)

    def next_one(self):
        """Wait for a transform that will be sent."""
        self.check('sent', time_of(self.number + self.random.randrange(3)), LONG)

    def missing(self):
        """Wait in vain."""
        try:
            self.buffer.lookup_transform('map', 'nobody', LATEST, Duration(seconds=0.003))
        except LookupException:
            return
        self.problems.append('nobody was found')

    def can(self):
        """Ask for a frame that exists, and for one that does not."""
        self.buffer.can_transform('map', 'sent', LATEST, LONG)
        self.buffer.can_transform('map', 'nobody', LATEST, Duration(seconds=0.002))

    def block(self):
        """Look up twice in one state of the buffer."""
        with self.buffer.updated():
            first, second = self.check('sent', LATEST), self.check('sent', LATEST)
        if first.header.stamp != second.header.stamp:
            self.problems.append('the data changed in a block')

    def many(self):
        """Look all samples up at once."""
        number = self.number
        times = [max(1, number - i) * 10**6 for i in range(20)]
        translations, _, valid = self.buffer.lookup_transforms('map', 'sent', times)
        if any(x * 10**6 != at for x, at in zip(translations[valid, 0],
                                                [t for t, v in zip(times, valid) if v])):
            self.problems.append('lookup_transforms')

    def insert(self):
        """Insert a transform."""
        self.inserted += 1
        self.buffer.set_transform(row_message('own', self.inserted), 'main')

    def publish(self):
        """Send a transform, and receive it: otherwise the queue of 100 messages would overflow."""
        self.broadcaster.sendTransform(row_message('published', self.number))
        self.latest()

    def future(self):
        """Start to wait for a transform, and stop."""
        self.buffer.wait_for_transform_async('map', 'nobody', LATEST).cancel()

    def frames(self):
        """List the frames."""
        self.buffer.frames()

    def run(self):
        """Do all of this with interrupts at random times; return how many hit what."""
        works = [self.latest, self.next_one, self.missing, self.can, self.block, self.many,
                 self.insert, self.publish, self.future, self.frames]
        signal.signal(signal.SIGALRM, signal.default_int_handler)
        hits: Counter[str] = Counter()
        while sum(hits.values()) < INTERRUPTS or any(
                hits[work.__name__] < OF_A_KIND for work in works):
            work = self.random.choice(works)
            delay = 10 ** self.random.uniform(-5.5, -2.0)
            try:
                # It comes again if it was raised in a destructor, which cannot pass it on.
                signal.setitimer(signal.ITIMER_REAL, delay, 2.0)
                while True:
                    work()
            except KeyboardInterrupt:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
                hits[work.__name__] += 1
        return hits

    def end(self):
        """Check that the buffer and its listener work, and end all."""
        assert not engine_of(self.buffer).is_held()
        answers: list[object] = []
        thread = threading.Thread(target=lambda: answers.append(self.check('sent', LATEST)))
        thread.start()
        thread.join(LONG.nanoseconds / S)
        assert len(answers) == 1, 'another thread cannot look up'
        self.check('sent', time_of(self.number + 20), LONG)
        self.insert()
        self.check('own', time_of(self.inserted))
        waited = self.waited
        eventually(lambda: self.waited > waited)
        dump = self.buffer.dump()
        for name in 'sent', 'own', 'published':
            stamps, poses = dump[name]['stamps'], dump[name]['poses']
            assert len(stamps) > 1
            assert stamps == [round(pose[0]) * 10**6 for pose in poses], name
        self.has_waited.set()
        self.waiter.join()
        self.has_sent.set()
        self.sender.join()
        gc.collect()
        assert not engine_of(self.buffer).is_awaited
        assert not self.problems, self.problems[:3]


def time_of(number):
    """Return the time of the transform with a number."""
    return Time(nanoseconds=number * 10**6)


def row_message(frame, number):
    """Return the message with a transform whose x is its stamp in ms."""
    return stamped('map', frame, number * 10**6, float(number))


def interrupt(seed):
    """Print as JSON: the figures before and after the interrupts, and how many hit what."""
    sys.unraisablehook = print_unraisable  # rclpy's Future.__del__ fails if __init__ did not end
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    interrupted = Interrupted(int(seed))
    interrupted.buffer.can_transform('map', 'sent', LATEST, LONG)
    before = figures()
    try:
        hits = interrupted.run()
        after = figures()
        interrupted.end()
    finally:
        interrupted.has_waited.set()
        interrupted.has_sent.set()
    interrupted.listener.unregister()
    destroy(interrupted.node)
    print(json.dumps([before, after, hits]))


if __name__ == '__main__':
    globals()[sys.argv[1]](*sys.argv[2:])
