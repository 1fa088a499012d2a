"""A ROS node of the test itself."""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
import threading
import time
from typing import Any, Optional, TypeVar

from geometry_msgs.msg import PointStamped, TransformStamped
from processes import own_pids, TIMEOUT
import pytest
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from rclpy.utilities import (
    get_default_context,
    get_rmw_implementation_identifier,
    ok,
    try_shutdown,
)

from puretf import Buffer, TransformListener
from puretf._core.engine import engine_of
from puretf_tools.cli.fast_dds import destroy
from puretf_tools.cli.node import ros_context

NodeType = TypeVar('NodeType', bound=Node)
_Result = TypeVar('_Result')
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Ros:
    """A node of the test itself, and the executor that spins it."""

    def __init__(self, domain: int, context: Optional[Context] = None) -> None:
        """Create a node and its executor, and a context in the domain if none is given."""
        self.context, self.domain = context or Context(), domain
        if context is None:
            self.context.init(domain_id=domain)
        self.node = Node('test', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def until(self, condition: Callable[[], object], timeout: float = TIMEOUT) -> None:
        """Spin until the condition holds; fail if it does not within the timeout (s)."""
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, f'Waited in vain. {self.foreign_publishers_text()}'
            self.executor.spin_once(timeout_sec=0.05)

    @contextmanager
    def spinning(self) -> Iterator[None]:
        """Spin in a thread until the end of the block, such as while a command is called."""
        is_over = threading.Event()

        def spin() -> None:
            while not is_over.is_set():
                self.executor.spin_once(timeout_sec=0.05)

        thread = threading.Thread(target=spin)
        thread.start()
        try:
            yield
        finally:
            is_over.set()
            thread.join()

    def foreign_publishers(self) -> list[str]:
        """
        Return the publishers of TF in this domain that no process of the tests has created.

        Fast DDS writes the lower half of the process id into the fifth and sixth byte of a gid.
        """
        if not self.context.ok() or 'fastrtps' not in get_rmw_implementation_identifier():
            return []
        own = {pid & 0xffff for pid in own_pids}
        return sorted({
            f'{info.node_namespace.rstrip("/")}/{info.node_name} of process {pid}'
            for topic in ('/tf', '/tf_static')
            for info in self.node.get_publishers_info_by_topic(topic)
            if (pid := int.from_bytes(bytes(info.endpoint_gid[4:6]), 'little')) not in own})

    def foreign_publishers_text(self) -> str:
        """Return a text that names the foreign publishers and the remedy; '' if there is none."""
        if publishers := self.foreign_publishers():
            return (f'In the domain {self.domain} of this test, other processes publish TF: '
                    f'{", ".join(publishers)}. End them.')
        return ''

    def close(self) -> None:
        """Destroy the executor, the node and the context."""
        self.executor.shutdown()
        destroy(self.node)
        self.context.try_shutdown()


@contextmanager
def command_node(make_node: Callable[[], NodeType], domain: int, *arguments: str
                 ) -> Iterator[tuple[NodeType, Ros]]:
    """
    Create the node of a command with ROS arguments, and a node of the test that is spun with it.

    Both are in rclpy's default context, and have one participant: `destroy` needs the only one.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain))
        with ros_context(['command', *arguments]), closing(
                Ros(domain, get_default_context())) as ros:
            node = make_node()
            ros.executor.add_node(node)
            try:
                yield node, ros
            finally:
                ros.executor.remove_node(node)
                node.destroy_node()


def eventually(condition: Callable[[], object]) -> None:
    """Wait until a condition holds, without spinning anything."""
    deadline = time.monotonic() + TIMEOUT
    while not condition():
        assert time.monotonic() < deadline, 'the condition did not become true in time'
        time.sleep(0.002)


def when_awaited(buffer: Any, call: Callable[[], object]) -> threading.Thread:
    """Call a function in a thread as soon as a lookup or a future waits; return the thread."""
    def run() -> None:
        eventually(lambda: engine_of(buffer).is_awaited)
        call()

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def run_in_thread(work: Callable[[], _Result]) -> _Result:
    """Call a function in a thread, wait until it returns, and return its result."""
    results: list[_Result] = []
    thread = threading.Thread(target=lambda: results.append(work()), daemon=True)
    thread.start()
    thread.join(2 * TIMEOUT)
    assert results, 'the function did not return in time, or has failed'
    return results[0]


def stamped(parent: str, child: str, stamp: int = 0, x: float = 0.0) -> TransformStamped:
    """Return a message with a transform that does not rotate; the stamp in ns, x in m."""
    message = TransformStamped()
    message.header.frame_id, message.child_frame_id = parent, child
    message.header.stamp = Time(nanoseconds=stamp).to_msg()
    message.transform.translation.x = x
    return message


def pose_of(transform: TransformStamped) -> list[float]:
    """Return x, y, z (m), quaternion x, y, z, w."""
    t, r = transform.transform.translation, transform.transform.rotation
    return [t.x, t.y, t.z, r.x, r.y, r.z, r.w]


def point(frame: str, stamp: int = 0) -> PointStamped:
    """Return a message with a header; the stamp in ns."""
    message = PointStamped()
    message.header.frame_id, message.header.stamp = frame, Time(nanoseconds=stamp).to_msg()
    return message


@pytest.fixture
def ros(domain_id: int) -> Iterator[Ros]:
    """A node in the ROS domain of the test."""
    node = Ros(domain_id)
    yield node
    text = node.foreign_publishers_text()
    node.close()
    assert not text, text


@pytest.fixture
def stranger(domain_id: int) -> Iterator[Ros]:
    """A node of another participant: within one, a topic cannot have two types."""
    with closing(Ros(domain_id)) as node:
        yield node


@pytest.fixture
def make_node(ros: Ros) -> Iterator[Callable[..., Node]]:
    """
    Create nodes of the participant of `ros` by `make_node(name, …)`; destroy them after the test.

    With `is_spun=True`, `ros` spins the node, too; `kind` is its class.
    """
    nodes: list[Node] = []

    def make(*args: Any, is_spun: bool = False, kind: type[Node] = Node, **kwargs: Any) -> Node:
        nodes.append(kind(*args, context=ros.context, **kwargs))
        if is_spun:
            ros.executor.add_node(nodes[-1])
        return nodes[-1]

    yield make
    for node in nodes:
        ros.executor.remove_node(node)
        node.destroy_node()


@pytest.fixture
def other(make_node: Callable[..., Node]) -> Node:
    """The node /other."""
    return make_node('other')


@pytest.fixture
def listening(ros: Ros) -> Iterator[Buffer]:
    """A buffer with the transforms that arrive at the node of the test."""
    buffer = Buffer(node=ros.node)
    listener = TransformListener(buffer, ros.node)
    yield buffer
    listener.unregister()


@pytest.fixture(autouse=True)
def closed_context() -> Iterator[None]:
    """Fail a test that leaves rclpy's default context open: the next command could not open it."""
    yield
    is_open = ok()
    try_shutdown()
    assert not is_open, "rclpy's default context was left open"
