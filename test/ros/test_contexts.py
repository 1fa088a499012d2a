"""Two contexts of rclpy in one process, each with a listener."""

import os
import threading
import time

from processes import TIMEOUT
import pytest
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time
from ros_node import eventually, stamped

from puretf import Buffer, TransformBroadcaster, TransformException, TransformListener
from puretf._causes.domains import ros_domains
from puretf._core.engine import engine_of
from puretf_tools.cli.fast_dds import destroy

LATEST = Time()
WAIT = Duration(seconds=TIMEOUT)


def moving(frame):
    """Return a transform of now."""
    return stamped('map', frame, time.time_ns(), 1.0)


def names_of_threads():
    """Return the names of the threads that are running."""
    return [thread.name for thread in threading.enumerate()]


@pytest.mark.parametrize('ended', [0, 1])
@pytest.mark.parametrize('is_elsewhere', [False, True], ids=['same domain', 'two domains'])
def test_two_contexts(domain_id, is_elsewhere, ended):
    """
    Each listener receives its own domain, and goes on when the other context is shut down.

    A lookup that waits in that context ends, and one in the other context gets its transform.
    """
    contexts, nodes, senders, buffers, listeners = [], [], [], [], []
    for i in 0, 1:
        contexts.append(Context())
        contexts[i].init(domain_id=domain_id + 100 * is_elsewhere * i)
        nodes.append(Node(f'context_{i}', context=contexts[i]))
        senders.append(TransformBroadcaster(nodes[i]))
        buffers.append(Buffer(node=nodes[i]))
        listeners.append(TransformListener(buffers[i], nodes[i]))

    def send_until(i, condition):
        """Send the frame of a context until a condition holds."""
        def holds():
            senders[i].sendTransform(moving(f'frame_{i}'))
            return condition()

        eventually(holds)

    for i, buffer in enumerate(buffers):
        send_until(i, lambda: buffer.can_transform('map', f'frame_{i}', LATEST))  # noqa: B023
    domains = {context.get_domain_id() for context in contexts}
    assert ros_domains([os.getpid()]) == dict.fromkeys(domains, os.getpid())
    for i, buffer in enumerate(buffers):
        if is_elsewhere:
            assert not buffer.can_transform('map', f'frame_{1 - i}', LATEST)
        else:
            send_until(1 - i, lambda: buffer.can_transform(  # noqa: B023
                'map', f'frame_{1 - i}', LATEST))  # noqa: B023

    ends: list[dict[str, object]] = [{}, {}]

    def wait(i):
        try:
            ends[i]['found'] = buffers[i].lookup_transform('map', 'late', LATEST, WAIT)
        except TransformException as error:
            ends[i]['error'] = error

    waiting = [threading.Thread(target=wait, args=(i,)) for i in (0, 1)]
    for thread in waiting:
        thread.start()
    stays = 1 - ended
    eventually(lambda: all(engine_of(buffer).is_awaited for buffer in buffers))
    contexts[ended].shutdown()
    waiting[ended].join()
    assert ends[ended].keys() == {'error'}
    now = time.time_ns()
    send_until(stays, lambda: buffers[stays].can_transform(
        'map', f'frame_{stays}', Time(nanoseconds=now)))
    assert not ends[stays]
    senders[stays].sendTransform(moving('late'))
    waiting[stays].join()
    assert ends[stays].keys() == {'found'}
    eventually(lambda: f'tf of context_{ended}' not in names_of_threads())
    assert f'tf of context_{stays}' in names_of_threads()
    listeners[ended].unregister()
    nodes[ended].destroy_node()
    listeners[stays].unregister()
    destroy(nodes[stays])
    contexts[stays].try_shutdown()
