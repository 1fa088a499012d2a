"""
End a listener in the midst of traffic, again and again.

    endings.py COUNT in WHERE OFFSET    in one process, by all orders of unregister(),
                                        destroy_node() and shutdown(): in the main thread (`main`),
                                        in a callback of the executor that spins the node
                                        (`executor`), or in one that the listener's thread calls
                                        (`thread`)
    endings.py COUNT by HOW OFFSET      in processes of their own: what ends them is the end of
                                        their program (`end`), sys.exit() in a callback (`exit`),
                                        or SIGINT while they spin (`spin`) or wait (`lookup`)

OFFSET is added to the domain id, for two that run at the same time. A thread has to be over in
time, a process with exit code 0 and without a word. Prints 'all ended'.
"""

from itertools import permutations
import os
import select
import signal
import sys
import threading
import time
import traceback
import warnings

import dummy_arm.tf.buffer_core  # noqa: F401  (all that may be imported before a fork)

ENDING = 0.5  # s
STILL = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
FRAMES = 20
STEPS = ('unregister', 'destroy_node', 'shutdown')
ORDERS = [(step,) for step in STEPS] + [*permutations(STEPS)]


def listener_threads():
    """List the threads of listeners."""
    return [thread for thread in threading.enumerate() if thread.name.startswith('tf of')]


class Ending:
    """A listener to what its own process publishes."""

    def __init__(self, steps=()):
        """Listen, until there is something."""
        import rclpy
        from rclpy.duration import Duration
        from rclpy.time import Time
        from rclpy.utilities import ok

        from dummy_arm.tf import Buffer, TransformBroadcaster, TransformListener

        self.steps, self.rclpy, self.latest = steps, rclpy, Time()
        if not ok():
            rclpy.init()
        self.node = rclpy.create_node('ending')
        self.buffer = Buffer(node=self.node)
        self.listener = TransformListener(self.buffer, self.node)
        self.broadcaster = TransformBroadcaster(self.node)
        self.prepared = self.broadcaster.prepare(
            [(f'frame_{i}', f'frame_{i + 1}') for i in range(FRAMES)])
        self.publish(1)
        self.buffer.lookup_transform(
            'frame_0', f'frame_{FRAMES}', self.latest, timeout=Duration(seconds=10))

    def publish(self, count):
        """Publish messages, as fast as can be."""
        for _ in range(count):
            self.prepared.send(time.time_ns(), [STILL] * FRAMES)

    def end(self, *_):
        """Do the steps while messages come in; then a lookup gives an answer still."""
        self.publish(10)
        (thread,) = listener_threads()
        over = []
        watching = threading.Thread(target=lambda: over.append((thread.join(), time.monotonic())))
        watching.start()
        for step in self.steps:
            getattr(self, step)()
        done = time.monotonic()  # no sooner, since rclpy keeps the GIL while DDS takes its time
        if threading.current_thread() is not thread:
            watching.join()
            if over[0][1] - done > ENDING:
                sys.exit(f'{self.steps}: the thread went on for {over[0][1] - done:.2f} s')
        self.buffer.lookup_transform('frame_0', f'frame_{FRAMES}', self.latest)

    def unregister(self):
        """End it as tf2 does."""
        self.listener.unregister()

    def destroy_node(self):
        """End it by its node."""
        self.node.destroy_node()

    def shutdown(self):
        """End it with all of ROS."""
        self.rclpy.try_shutdown()

    def in_main(self):
        """End it here."""
        self.end()

    def in_executor(self):
        """End it in a callback of an executor."""
        def end():
            timer.cancel()
            self.end()
            ended.append(True)

        ended: list[bool] = []
        executor = self.rclpy.executors.SingleThreadedExecutor()
        executor.add_node(self.node)
        timer = self.node.create_timer(0.0, end)
        while not ended:
            executor.spin_once()
        executor.shutdown()

    def in_thread(self):
        """End it in its own thread."""
        ended = threading.Event()

        def end(_):
            self.end()
            ended.set()

        self.buffer.wait_for_transform_async(
            'frame_0', 'late', self.latest).add_done_callback(end)
        self.broadcaster.prepare([('frame_0', 'late')]).send(time.time_ns(), [STILL])
        if not ended.wait(10):
            sys.exit('the callback was not called, or failed')
        for thread in listener_threads():
            thread.join(ENDING)
        if listener_threads():
            sys.exit(f'{self.steps}: the thread goes on after its callback')


def by_end(_):
    """Come to the end of the program while messages come in."""
    ending = Ending()
    ending.publish(10)


def by_exit(_):
    """Leave the interpreter in a callback."""
    ending = Ending()
    ending.node.create_timer(0.0, sys.exit)
    ending.publish(10)
    ending.rclpy.spin(ending.node)


def by_spin(ready):
    """Spin until SIGINT."""
    ending = Ending()

    def tell():
        timer.cancel()
        os.write(ready, b'.')

    timer = ending.node.create_timer(0.0, tell)
    # SIGINT may interrupt rclpy's executor where it has made a coroutine and not begun it, or half
    # of a task: their ends are said, and are not ours.
    warnings.filterwarnings('ignore', "coroutine 'Executor", RuntimeWarning)
    sys.unraisablehook = without_rclpy
    ending.rclpy.spin(ending.node)


def by_lookup(ready):
    """Wait for a transform until SIGINT."""
    ending = Ending()
    threading.Timer(0.01, lambda: os.write(ready, b'.')).start()
    ending.buffer.lookup_transform('frame_0', 'nobody', ending.latest,
                                   timeout=ending.rclpy.duration.Duration(seconds=60))


def without_rclpy(unraisable):
    """Say what could not be raised, unless only rclpy has a part in it."""
    files = [summary.filename for summary in traceback.extract_tb(unraisable.exc_traceback)]
    if not files or not all(f'{os.sep}rclpy{os.sep}' in file for file in files):
        sys.__unraisablehook__(unraisable)


def without_others(output):
    """
    Leave out what others say.

    Fast DDS says that processes which start at the same time wanted the same shared memory. The
    thread of rclpy that handles signals shuts the context down and then triggers the guard
    conditions of executors; if one of them is destroyed in between, it says so.
    """
    return ''.join(
        line for line in output.splitlines(keepends=True) if 'RTPS_TRANSPORT_SHM' not in line
        and '[rclpy.signals]: rcl_trigger_guard_condition() failed' not in line)


def process(how):
    """Run a process until it ends; give its exit code and all that it said."""
    ready, in_child = os.pipe()
    output, error = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.dup2(error, 1)
        os.dup2(error, 2)
        try:
            globals()[f'by_{how}'](in_child)
        except KeyboardInterrupt:
            pass
        except Exception as problem:  # of a spin or a wait that is ended by SIGINT
            if type(problem).__name__ not in (
                    'ExternalShutdownException', 'LookupException', 'RCLError'):
                raise
        sys.exit()
    os.close(error)
    os.close(in_child)
    if how in ('spin', 'lookup'):
        os.read(ready, 1)
        os.kill(pid, signal.SIGINT)
    said = b''
    while select.select([output], [], [], 20)[0] and (part := os.read(output, 4096)):
        said += part
    os.close(output)
    os.close(ready)
    return os.waitpid(pid, 0)[1], without_others(said.decode()).strip()


def main(count, kind, which, offset):
    """Do it so often."""
    os.environ['ROS_DOMAIN_ID'] = str(int(os.environ['ROS_DOMAIN_ID']) + int(offset))
    for _ in range(int(count)):
        if kind == 'by':
            status, said = process(which)
            if status or said:
                sys.exit(f'status {status}: {said}')
            continue
        for steps in ORDERS:
            ending = Ending(steps)
            getattr(ending, f'in_{which}')()
            ending.destroy_node()  # else its participant would go on beside the next
    print('all ended', flush=True)


if __name__ == '__main__':
    main(*sys.argv[1:])
