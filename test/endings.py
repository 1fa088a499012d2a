"""
End a listener while messages arrive, repeatedly.

    endings.py COUNT in WHERE OFFSET    In one process, by every order of unregister(),
                                        destroy_node() and shutdown(): in the main thread (`main`),
                                        in a callback of the executor that spins the node
                                        (`executor`), or in a callback of the listener's thread
                                        (`thread`).
    endings.py COUNT by HOW OFFSET      In separate processes, which are ended by the end of their
                                        program (`end`), by sys.exit() in a callback (`exit`), or
                                        by SIGINT while they spin (`spin`) or wait (`lookup`).

OFFSET is added to the domain id, so that two of these programs can run at the same time. Each
listener's thread must end in time, and each process with exit code 0 and without output. At the
end, the program prints 'all ended'.
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

import dummy_arm.tf.buffer_core  # noqa: F401  (nothing more may be imported before a fork)

#: The longest time in which a thread may end (s), on a busy machine, too.
ENDING = 5.0
STILL = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
FRAMES = 20
STEPS = ('unregister', 'destroy_node', 'shutdown')
ORDERS = [(step,) for step in STEPS] + [*permutations(STEPS)]


def listener_threads():
    """Return the threads of listeners."""
    return [thread for thread in threading.enumerate() if thread.name.startswith('tf of')]


class Ending:
    """A listener that receives what its own process publishes, and the ways to end it."""

    def __init__(self, steps=()):
        """Start the listener, and wait until it has received a message."""
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
        """Publish messages as fast as possible."""
        for _ in range(count):
            self.prepared.send(time.time_ns(), [STILL] * FRAMES)

    def end(self, *_):
        """Do the steps while messages arrive; check that a lookup still works after them."""
        self.publish(10)
        (thread,) = listener_threads()
        ends = []
        watching = threading.Thread(target=lambda: ends.append((thread.join(), time.monotonic())))
        watching.start()
        for step in self.steps:
            getattr(self, step)()
        # The time is measured from here: rclpy holds the GIL during the steps, which are slow.
        done = time.monotonic()
        if threading.current_thread() is not thread:
            watching.join()
            if ends[0][1] - done > ENDING:
                sys.exit(f'{self.steps}: the thread went on for {ends[0][1] - done:.2f} s')
        self.buffer.lookup_transform('frame_0', f'frame_{FRAMES}', self.latest)

    def unregister(self):
        """End the listener as with tf2."""
        self.listener.unregister()

    def destroy_node(self):
        """End the listener by destroying its node."""
        self.node.destroy_node()

    def shutdown(self):
        """End the listener by shutting ROS down."""
        self.rclpy.try_shutdown()

    def in_main(self):
        """Do the steps in the main thread."""
        self.end()

    def in_executor(self):
        """Do the steps in a callback of the executor that spins the node."""
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
        """Do the steps in a callback of the listener's thread."""
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
    """Return, so that the program ends while messages arrive."""
    ending = Ending()
    ending.publish(10)


def by_exit(_):
    """Call sys.exit() in a callback."""
    ending = Ending()
    ending.node.create_timer(0.0, sys.exit)
    ending.publish(10)
    ending.rclpy.spin(ending.node)


def by_spin(ready):
    """Spin until SIGINT; write to the pipe `ready` once the node is spinning."""
    ending = Ending()

    def report_ready():
        timer.cancel()
        os.write(ready, b'.')

    timer = ending.node.create_timer(0.0, report_ready)
    # SIGINT may interrupt rclpy's executor between the creation and the start of a coroutine, or
    # of a task. Python warns about them then; the listener is not the cause.
    warnings.filterwarnings('ignore', "coroutine 'Executor", RuntimeWarning)
    sys.unraisablehook = print_unraisable
    ending.rclpy.spin(ending.node)


def by_lookup(ready):
    """Wait for a transform until SIGINT; write to the pipe `ready` meanwhile."""
    ending = Ending()
    threading.Timer(0.01, lambda: os.write(ready, b'.')).start()
    ending.buffer.lookup_transform('frame_0', 'nobody', ending.latest,
                                   timeout=ending.rclpy.duration.Duration(seconds=60))


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
    conditions of executors; if one of them is destroyed in between, rclpy prints a line.
    """
    return ''.join(
        line for line in output.splitlines(keepends=True) if 'RTPS_TRANSPORT_SHM' not in line
        and '[rclpy.signals]: rcl_trigger_guard_condition() failed' not in line)


def run_process(ending):
    """Run a process until it ends; return its exit status and its output."""
    ready, in_child = os.pipe()
    output, error = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.dup2(error, 1)
        os.dup2(error, 2)
        try:
            globals()[f'by_{ending}'](in_child)
        except KeyboardInterrupt:
            pass
        except Exception as problem:  # a spin or a wait that SIGINT ends raises one of these
            if type(problem).__name__ not in (
                    'ExternalShutdownException', 'LookupException', 'RCLError'):
                raise
        sys.exit()
    os.close(error)
    os.close(in_child)
    if ending in ('spin', 'lookup'):
        os.read(ready, 1)
        os.kill(pid, signal.SIGINT)
    written = b''
    while select.select([output], [], [], 20)[0] and (part := os.read(output, 4096)):
        written += part
    os.close(output)
    os.close(ready)
    return os.waitpid(pid, 0)[1], without_library_lines(written.decode()).strip()


def main(count, kind, which, offset):
    """End listeners, or processes with a listener, as often as `count` says."""
    os.environ['ROS_DOMAIN_ID'] = str(int(os.environ['ROS_DOMAIN_ID']) + int(offset))
    for _ in range(int(count)):
        if kind == 'by':
            status, written = run_process(which)
            if status or written:
                sys.exit(f'status {status}: {written}')
            continue
        for steps in ORDERS:
            ending = Ending(steps)
            getattr(ending, f'in_{which}')()
            ending.destroy_node()  # otherwise its participant would exist beside the next one
    print('all ended', flush=True)


if __name__ == '__main__':
    main(*sys.argv[1:])
