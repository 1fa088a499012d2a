"""
A program that ends listeners, with a random delay at each step of each end.

    late_ends.py SEED COUNT LONGEST DOMAIN

ends COUNT listeners one after the other, in all orders, in all threads; each step takes up to
LONGEST s more, also in the listener's thread. A correct end prints nothing.
"""

import faulthandler
from pathlib import Path
import random
import sys
import threading
import time

from endings import Ending, ORDERS, TIMEOUT
from rclpy.context import Context

from puretf import TransformListener
from puretf.publisher_listener import PublisherListener
from puretf_tools.cli.fast_dds import destroy

#: The Python functions that are delayed, by file, and the compiled ones. The delay of `wait` comes
#: after it, when the thread still uses its handles.
STEPS = {
    'node.py': {'destroy_node', 'destroy_publisher', 'destroy_subscription',
                'destroy_guard_condition'},
    'subscription.py': {'destroy', 'take', 'check', 'close', '_take'},
    'guard_condition.py': {'destroy', 'trigger'}, 'context.py': {'shutdown', 'try_shutdown'},
    'listener_thread.py': {'end', 'stop', 'wake', '_wait', '_wake_executor'},
    'transform_listener.py': {'unregister', '_detach', '_end', '_release'},
    'executors.py': {'remove_node', 'shutdown', 'wake'}, 'engine.py': {'remove_source'}}
COMPILED = {'call': {'destroy_when_not_in_use', 'join'}, 'return': {'wait'}}


class Overriding(TransformListener):
    """A listener with subscriptions of the node, which a thread spins."""

    def callback(self, data):
        """Insert as before."""
        super().callback(data)


class EndingCommand(Ending):
    """The end of a node of a command."""

    def destroy_node(self):
        """Detach the discovery listener, too."""
        destroy(self.node)


class Delays:
    """Random delays, as a profile function of all threads."""

    def __init__(self, longest):
        """Delay nothing before `is_on`."""
        self.longest, self.is_on = longest, False

    def __call__(self, frame, event, argument):
        """Sleep if a step of an end begins, or after a wait in the middleware."""
        if not self.is_on:
            return
        if event == 'call':
            code = frame.f_code
            if code.co_name not in STEPS.get(Path(code.co_filename).name, ()):
                return
        elif getattr(argument, '__name__', '') not in COMPILED.get(event[2:], ()):
            return
        time.sleep(max(0.0, random.uniform(-2 * self.longest, self.longest)))


def end_one(domain, delays):
    """End one listener; leave its thread alone if the dice say so."""
    context = Context()
    context.init(domain_id=domain)
    kind = random.choice([TransformListener, PublisherListener, Overriding])
    where = random.choice(['main', 'executor', 'thread'] if kind is not Overriding else ['main'])
    ending = random.choice([Ending, EndingCommand])(random.choice(ORDERS), context, kind)
    delays.is_on = True
    getattr(ending, f'end_in_{where}')()
    if random.random() < 0.5:
        delays.is_on = False
        ending.thread.join(TIMEOUT)
        assert not ending.thread.is_alive(), 'the thread goes on'
    ending.node.destroy_node()
    context.try_shutdown()


def main(seed, count, longest, domain):
    """End listeners; the first sign of trouble is a line of output, or the exit code."""
    faulthandler.enable()
    random.seed(seed)
    delays = Delays(longest)
    sys.setprofile(delays)
    threading.setprofile(delays)
    for _ in range(count):
        end_one(domain, delays)
    delays.is_on = False


if __name__ == '__main__':
    main(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4]))
