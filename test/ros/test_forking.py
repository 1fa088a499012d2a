"""A fork of a process that listens to ROS."""

CODE = """
import os, signal, threading, time

def in_child(work, meanwhile):
    pid = os.fork()
    if not pid:
        signal.alarm(60)  # ends a child that hangs
        code = 1
        try:
            work()
            code = 0
        except BaseException as error:
            print('child:', repr(error), flush=True)
        finally:
            os._exit(code)
    meanwhile()
    _, status = os.waitpid(pid, 0)
    assert status == 0, status

import rclpy
from puretf import (Buffer, Transform, TransformBroadcaster, TransformException,
                    TransformListener)
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
    broadcaster.sendTransform(Transform(
        100 * 10**9 + number, 'map', 'tool', (float(number), 0.0, 0.0)).to_message())
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

reading, writing = os.pipe()
def send_more():
    before = x()
    while x() == before:
        time.sleep(0.001)
    os.write(writing, b'.')

try:
    buffer.lookup_transform('map', 'tol', Time())
except TransformException as error:
    unread = error

def look():
    assert "Nearest known: 'tool'. More: " in str(unread), unread
    assert threading.active_count() == 1
    before = x()
    assert before >= sent, (before, sent)
    os.read(reading, 1)  # meanwhile, the parent has received more
    assert x() == before
    assert not buffer.can_transform('map', 'late', Time(), Duration(seconds=0.2))
    buffer.set_transform(Transform(100 * 10**9, 'map', 'late').to_message(), 'child')
    assert buffer.can_transform('map', 'late', Time())
    assert not waiting.done() and not kept.done()
    try:
        buffer.wait_for_transform_async('map', 'nobody', Time(), Duration(seconds=0.1))
    except RuntimeError as error:
        assert 'before the process was forked' in str(error), error
    else:
        assert False, 'nothing would complete this future'
    listener.unregister()
    assert x() == before

ends = False
def send_on():
    while not ends:
        send()
        time.sleep(0.001)
sender = threading.Thread(target=send_on)
sender.start()
try:
    for _ in range(3):
        while x() < number - 10:
            time.sleep(0.001)
        sent = x()
        in_child(look, send_more)
finally:
    ends = True
    sender.join()
buffer.set_transform(Transform(100 * 10**9, 'map', 'late').to_message(), 'parent')
thread.join(60)
assert len(blocked) == 1
assert waiting.done() and kept.done()
rclpy.shutdown()
print('done')
"""


def test_a_child_of_a_process_that_listens(start):
    """The child has no sources, threads or futures; those of the parent go on."""
    process = start('-W', 'ignore::DeprecationWarning', '-c', CODE)
    assert process.exit_code() == 0, process.output
    assert process.output == 'True called\ndone\n'
