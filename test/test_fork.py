"""Tests of forks: the child process looks up in the buffers that it has inherited."""

import os

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, 'fork'), reason='there is no os.fork here')

FORKED = """
import os, signal, sys, threading, time

def in_child(work):
    # The alarm ends a child that hangs. An exception in the child is printed.
    pid = os.fork()
    if not pid:
        signal.alarm(20)
        code = 1
        try:
            work()
            code = 0
        except BaseException as error:
            print('child:', repr(error), flush=True)
        finally:
            os._exit(code)
    _, status = os.waitpid(pid, 0)
    assert status == 0, status
"""

NO_ROS = FORKED + """
from dummy_arm.tf import BufferCore, TransformException
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
buffer = BufferCore()
buffer.insert(1, 'map', 'tool', STILL)
def x():
    return buffer.lookup_transform('map', 'tool').translation[0]
"""

BUSY = NO_ROS + """
ends = False
def insert():
    number = 1
    while not ends:
        number += 1
        with buffer.fetched():
            buffer.insert(number, 'map', 'tool', (float(number), *STILL[1:]))
            time.sleep(0.001)
thread = threading.Thread(target=insert)
thread.start()
try:
    for _ in range(30):
        in_child(x)
    before = x()
    while x() == before:
        time.sleep(0.001)
finally:
    ends = True
    thread.join()
print('done')
"""

AS_OF_THE_FORK = NO_ROS + """
reading, writing = os.pipe()
forked, forking = os.pipe()
def look():
    os.write(forking, b'.')
    os.read(reading, 1)  # returns after the parent has inserted a sample
    assert x() == 0.0
    buffer.insert(3, 'map', 'tool', (3.0, *STILL[1:]))
    assert x() == 3.0
    try:
        buffer.lookup_transform('map', 'nobody', timeout=200_000_000)
    except TransformException as error:
        assert 'does not exist' in str(error)
    else:
        raise AssertionError
def more():
    os.read(forked, 1)
    buffer.insert(2, 'map', 'tool', (2.0, *STILL[1:]))
    os.write(writing, b'.')
threading.Thread(target=more).start()
in_child(look)
assert x() == 2.0
print('done')
"""

PENDING = NO_ROS + """
from dummy_arm.tf._core.pose import Row, Rows
class Source:
    # A transform has arrived in the queue, and no thread has inserted it when the process forks.
    def __init__(self):
        self.batches = [Rows([Row(2, 'map', 'tool', (2.0, *STILL[1:]))], 'sent', False)]
    def take(self):
        return self.batches
    def wake(self):
        pass
buffer.add_source(Source())
def look():
    assert x() == 2.0
in_child(look)
print('done')
"""

NESTED = NO_ROS + """
# The process forks in a block that holds the lock. Then the lock is free in both processes.
def block():
    with buffer.fetched():
        pid = os.fork()
        if not pid:
            signal.alarm(20)
    free = []
    thread = threading.Thread(target=lambda: free.append(x()))
    thread.start()
    thread.join(10)
    assert free == [0.0]
    return pid
pid = block()
if not pid:
    os._exit(0)
assert os.waitpid(pid, 0)[1] == 0
print('done')
"""

POOL = NO_ROS + """
import multiprocessing
import numpy as np
for i in range(2, 1000):
    buffer.insert(i, 'map', 'tool', (float(i), *STILL[1:]))
def look(time):
    return buffer.lookup_transform('map', 'tool', time).translation[0]
if __name__ == '__main__':
    with multiprocessing.get_context('fork').Pool(3) as pool:
        assert pool.map(look, range(2, 1000)) == [float(i) for i in range(2, 1000)]
    print('done')
"""


SEVERAL = NO_ROS + """
# A thread may wait for the lock of one buffer while it holds that of another.
other = BufferCore()
ends = False
def insert():
    number = 1
    while not ends:
        number += 1
        with other.fetched():
            time.sleep(0.0001)
            buffer.insert(number, 'map', 'tool', STILL)
thread = threading.Thread(target=insert)
thread.start()
try:
    for _ in range(30):
        in_child(x)
finally:
    ends = True
    thread.join()
print('done')
"""

HELD = NO_ROS + """
# A lock that is never free: the process forks without it, and the child drops the dynamic
# transforms.
from dummy_arm.tf._core import forking
forking._PATIENCE = 0.2
buffer.insert(0, 'map', 'fixed', STILL, is_static=True)
is_held, is_over = threading.Event(), threading.Event()
def hold():
    with buffer.fetched():
        is_held.set()
        is_over.wait()
thread = threading.Thread(target=hold)
thread.start()
is_held.wait()
def look():
    assert buffer.can_transform('map', 'fixed')
    assert not buffer.can_transform('map', 'tool')
    buffer.insert(5, 'map', 'tool', (5.0, *STILL[1:]))
    assert x() == 5.0
in_child(look)
is_over.set()
thread.join()
assert x() == 0.0
print('done')
"""

INTERRUPTED = HELD.split('def look')[0] + """
forking._PATIENCE = 2.0
def interrupt():
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.2)
    is_over.set()
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have ignored it
threading.Timer(0.2, interrupt).start()
try:
    in_child(x)
    for _ in range(1000):  # interrupt_main() does not end a long sleep
        time.sleep(0.01)
except KeyboardInterrupt:
    print('done')
"""

SOURCES = NO_ROS + """
# A source that raises an exception does not disturb the fork.
class Source:
    def take(self):
        if is_forking:
            raise ValueError
        return []
    def wake(self):
        pass
is_forking = False
buffer.add_source(Source())
def look():
    assert x() == 0.0
    answers = []
    thread = threading.Thread(target=lambda: answers.append(x()))
    thread.start()
    thread.join(5)
    assert answers == [0.0]
is_forking = True
in_child(look)
is_forking = False
answers = []
thread = threading.Thread(target=lambda: answers.append(x()))
thread.start()
thread.join(5)
assert answers == [0.0]
print('done')
"""


@pytest.mark.parametrize('code', [
    BUSY, AS_OF_THE_FORK, PENDING, NESTED, POOL, SEVERAL, HELD, INTERRUPTED, SOURCES], ids=[
    'busy', 'as_of_the_fork', 'pending', 'nested', 'pool', 'several', 'held', 'interrupted',
    'sources'])
def test_lookups_in_a_child(start, code):
    """Lookups use the data from the time of the fork, whatever the parent's threads do."""
    process = start('-W', 'ignore::DeprecationWarning', '-c', code)
    assert process.exit_code(60) == 0, process.output
    assert process.output == 'done\n'


WITH_ROS = FORKED + """
import rclpy
from dummy_arm.tf import Buffer, TransformBroadcaster, TransformException, TransformListener
from dummy_arm.tf._ros.transform_stamped import message_of
from rclpy.duration import Duration
from rclpy.time import Time

rclpy.init()
node = rclpy.create_node('forking')
buffer = Buffer(node=node)
listener = TransformListener(buffer, node)
broadcaster = TransformBroadcaster(node)
number = 0
def send():
    global number
    number += 1
    broadcaster.sendTransform(message_of(
        (100 * 10**9 + number, 'map', 'tool', (float(number), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))))
def x():
    return buffer.lookup_transform('map', 'tool', Time()).transform.translation.x
while not buffer.can_transform('map', 'tool', Time()):
    send()
    time.sleep(0.01)

waiting = buffer.wait_for_transform_async('map', 'late', Time(), Duration(seconds=60))
kept = buffer.wait_for_transform_async('map', 'late', Time())
kept.add_done_callback(lambda future: print(os.getpid() == parent, 'called'))
parent = os.getpid()
blocked = []
thread = threading.Thread(target=lambda: blocked.append(buffer.lookup_transform(
    'map', 'late', Time(), Duration(seconds=60))))
thread.start()

def look():
    assert threading.active_count() == 1
    before = x()
    assert before >= sent, (before, sent)
    time.sleep(0.1)
    assert x() == before
    assert not buffer.can_transform('map', 'late', Time(), Duration(seconds=0.2))
    buffer.set_transform(message_of(
        (100 * 10**9, 'map', 'late', (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))), 'child')
    assert buffer.can_transform('map', 'late', Time())
    assert not waiting.done() and not kept.done()
    future = buffer.wait_for_transform_async('map', 'nobody', Time(), Duration(seconds=0.1))
    while not future.done():
        time.sleep(0.01)
    assert 'nobody' in str(future.exception())
    assert buffer.wait_for_transform_async('map', 'tool', Time()).done()
    listener.unregister()
    assert x() == before

ends = False
def send_on():
    while not ends:
        send()
        time.sleep(0.001)
def ask_on():  # ok() takes a lock of the context, as executors do
    while rclpy.ok() and not ends:
        pass
sender, asker = threading.Thread(target=send_on), threading.Thread(target=ask_on)
sender.start()
asker.start()
try:
    for _ in range(10):
        while x() < number - 10:
            time.sleep(0.001)
        sent = x()
        in_child(look)
    before = x()
    while x() == before:
        time.sleep(0.001)
finally:
    ends = True
    sender.join()
    asker.join()
buffer.set_transform(message_of(
    (100 * 10**9, 'map', 'late', (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))), 'parent')
thread.join(20)
assert len(blocked) == 1
assert waiting.done() and kept.done()
rclpy.shutdown()
print('done')
"""


def test_a_child_of_a_process_that_listens(start):
    """The child has no sources, threads or futures; those of the parent go on."""
    process = start('-W', 'ignore::DeprecationWarning', '-c', WITH_ROS)
    assert process.exit_code(100) == 0, process.output
    assert process.output == 'True called\ndone\n'
