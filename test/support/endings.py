"""
Ends of a program that has a listener: each listener has to end, and the process cleanly.

Programs, which end with exit code 0 and without output but 'ready':

    endings.py end       ends by its last line, while messages arrive
    endings.py exit      calls sys.exit() in a callback
    endings.py spin      spins until SIGINT; prints 'ready' once the node is spinning
    endings.py lookup    waits for a transform until SIGINT; prints 'ready' meanwhile
"""

from contextlib import suppress
from itertools import permutations
import os
import re
import signal
import sys
import threading
import time
import traceback
import warnings

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.time import Time

from puretf import Buffer, LookupException, TransformBroadcaster, TransformListener
from puretf._core.engine import engine_of
from puretf._ros.rclpy_private import RCLError

STILL = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
FRAMES = 20
STEPS = ('unregister', 'destroy_node', 'shutdown')
ORDERS = [(step,) for step in STEPS] + [*permutations(STEPS)]
LATEST, TIMEOUT = Time(), 60.0
WAIT = Duration(seconds=TIMEOUT)


class Ending:
    """A listener that receives what its own node publishes, and the ways to end it."""

    def __init__(self, steps=(), context=None, kind=TransformListener):
        """Start the listener in a context, or the default one; wait for a message."""
        self.steps, self.context = steps, context
        self.node = rclpy.create_node('ending', context=context)
        self.buffer = Buffer(node=self.node)
        before = {*threading.enumerate()}
        self.listener = kind(self.buffer, self.node, spin_thread=True)
        (self.thread,) = {*threading.enumerate()} - before
        self.broadcaster = TransformBroadcaster(self.node)
        self.prepared = self.broadcaster.prepare(
            [(f'frame_{i}', f'frame_{i + 1}') for i in range(FRAMES)])
        while not self.broadcaster.pub_tf.get_subscription_count():  # Fast DDS 3 takes a moment
            time.sleep(0.001)
        self.publish(1)
        self.buffer.lookup_transform('frame_0', f'frame_{FRAMES}', LATEST, timeout=WAIT)

    def publish(self, count):
        """Publish messages as fast as possible."""
        for _ in range(count):
            self.prepared.send(time.time_ns(), [STILL] * FRAMES)

    def end(self):
        """Do the steps while messages arrive; check that a lookup still works after them."""
        self.publish(10)
        for step in self.steps:
            getattr(self, step)()
        self.buffer.lookup_transform('frame_0', f'frame_{FRAMES}', LATEST)

    def unregister(self):
        """End the listener as with tf2."""
        self.listener.unregister()

    def destroy_node(self):
        """End the listener by destroying its node."""
        self.node.destroy_node()

    def shutdown(self):
        """End the listener by shutting ROS down."""
        self.node.context.try_shutdown()

    def end_in_main(self):
        """Do the steps in the main thread."""
        self.end()

    def end_in_executor(self):
        """Do the steps in a callback of the executor that spins the node."""
        ended: list[bool] = []

        def end():
            timer.cancel()
            self.end()
            ended.append(True)

        executor = SingleThreadedExecutor(context=self.context)
        executor.add_node(self.node)
        timer = self.node.create_timer(0.0, end)
        while not ended:
            executor.spin_once()
        executor.shutdown()

    def end_in_thread(self):
        """Do the steps in a callback of the listener's thread."""
        ended = threading.Event()

        def end(_):
            self.end()
            ended.set()

        self.buffer.wait_for_transform_async('frame_0', 'late', LATEST).add_done_callback(end)
        self.broadcaster.prepare([('frame_0', 'late')]).send(time.time_ns(), [STILL])
        assert ended.wait(TIMEOUT), 'the callback was not called, or has failed'


def end_in_every_order(domain, where):
    """End listeners in each order of the steps, in their own contexts; check that all end."""
    for steps in ORDERS:
        context = Context()
        context.init(domain_id=domain)
        ending = Ending(steps, context)
        getattr(ending, f'end_in_{where}')()
        ending.thread.join(TIMEOUT)
        assert not ending.thread.is_alive()
        ending.node.destroy_node()
        context.try_shutdown()


def check_end(start, way):
    """Start a program that ends in a way, if need be by SIGINT; check that it ends cleanly."""
    process = start(__file__, way)
    if way in ('spin', 'lookup'):
        process.line_with('ready')
        process.end(signal.SIGINT)
    assert process.exit_code() == 0
    assert without_library_lines(process.output) in ('', 'ready\n')


def by_end():
    """Return, so that the program ends while messages arrive."""
    Ending().publish(10)


def by_exit():
    """Call sys.exit() in a callback."""
    ending = Ending()
    ending.node.create_timer(0.0, sys.exit)
    ending.publish(10)
    rclpy.spin(ending.node)


def by_spin():
    """Spin until SIGINT."""
    ending = Ending()

    def report_ready():
        timer.cancel()
        print('ready', flush=True)

    timer = ending.node.create_timer(0.0, report_ready)
    # SIGINT may interrupt rclpy's executor between the creation and the start of a coroutine, or
    # of a task. Python warns about them then; the listener is not the cause.
    warnings.filterwarnings('ignore', "coroutine 'Executor", RuntimeWarning)
    sys.unraisablehook = print_unraisable
    rclpy.spin(ending.node)


def by_lookup():
    """Wait for a transform until SIGINT."""
    ending = Ending()

    def report_ready():
        while not engine_of(ending.buffer).is_awaited:
            time.sleep(0.001)
        print('ready', flush=True)

    threading.Thread(target=report_ready).start()
    ending.buffer.lookup_transform('frame_0', 'nobody', LATEST, timeout=WAIT)


def print_unraisable(unraisable):
    """Print an unraisable exception, unless its traceback consists of rclpy only."""
    files = [summary.filename for summary in traceback.extract_tb(unraisable.exc_traceback)]
    if not files or not all(f'{os.sep}rclpy{os.sep}' in file for file in files):
        sys.__unraisablehook__(unraisable)


def without_library_lines(output):
    """
    Remove the lines that Fast DDS and rclpy may print in such a run.

    Fast DDS prints a line if processes that start at the same time want the same shared memory.
    The thread of rclpy that handles signals shuts the context down, and then triggers the guard
    conditions of executors; if one of them is destroyed in between, rclpy prints a line. Ctrl-C
    while python deletes an object of rclpy is ignored, with a traceback; the signal is recorded.
    """
    output = re.sub(r'Exception ignored in: <function \w+\.__del__ .*\nTraceback .*\n'
                    r'(?:(?: .*)?\n)*KeyboardInterrupt: ?\n', '', output)
    return ''.join(
        line for line in output.splitlines(keepends=True) if 'RTPS_TRANSPORT_SHM' not in line
        and '[rclpy.signals]: rcl_trigger_guard_condition() failed' not in line)


if __name__ == '__main__':
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException, LookupException, RCLError):
        globals()[f'by_{sys.argv[1]}']()
