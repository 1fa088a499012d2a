"""Tests of the behaviour of rclpy 7.1 and rcl on which puretf/_ros/rclpy_private.py relies."""

import ast
from collections.abc import Callable
from pathlib import Path
import time
from typing import Any

from builtin_interfaces.msg import Time
from environment import made_at_run_time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from messages import ignore
import pytest
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.guard_condition import GuardCondition
from rclpy.qos import qos_policy_name_from_kind, QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.task import Future
from rclpy.utilities import get_rmw_implementation_identifier
from ros_node import LATCHED, run_in_thread
from std_msgs.msg import Header, String

from puretf import TFMessage
from puretf._ros import rclpy_private
from puretf._ros.rclpy_private import (
    GID_SIZE,
    guard_condition,
    incompatible_qos,
    install,
    is_given,
    is_of_executor,
    missing_part,
    rcl_take,
    RCLError,
    rmw_subscription,
    subscribe,
    take_bytes,
    Taker,
    WaitSet,
)


@pytest.fixture
def strings(ros):
    """A publisher of String, and a subscription that is connected to it."""
    subscription = subscribe(ros.node, String, 'text', ignore, QoSProfile(depth=10),
                             ros.node.default_callback_group)
    publisher = ros.node.create_publisher(String, 'text', 10)
    ros.until(lambda: publisher.get_subscription_count() == 1)
    yield publisher, subscription
    subscription.destroy()


def test_no_part_is_missing():
    """The other tests show that the parts behave as the listener needs it."""
    assert missing_part() == ''


def test_take_bytes_returns_messages_and_their_infos(strings):
    """It returns one at most if one is wanted, and none if none has arrived."""
    publisher, subscription = strings
    assert take_bytes(subscription, 1) == []
    words = ['one', 'two', 'three']
    for word in words:
        publisher.publish(String(data=word))
    taken: list[Any] = []
    while len(taken) < len(words):
        taken += (new := take_bytes(subscription, 1))
        assert len(new) <= 1
    assert [data for data, _ in taken] == [serialize_message(String(data=word)) for word in words]
    assert all(info['received_timestamp'] > 10**18 for _, info in taken)


@pytest.mark.parametrize('message', [
    pytest.param(TFMessage(transforms=[TransformStamped(child_frame_id='tool')]),
                 id='replaced', marks=made_at_run_time),
    pytest.param(String(data='hello'), id='as before')])
def test_install_leaves_a_message_as_it_is(ros, message):
    """
    It is published, taken, serialized and deserialized: a TFMessage by what `install` has made.

    All four functions are looked up in their module or class at each call.
    """
    kind, received = type(message), list[object]()
    if kind is TFMessage:
        install(kind)  # as the import of TFMessage has done
    assert deserialize_message(serialize_message(message), kind) == message
    ros.node.create_subscription(kind, 'of_test', received.append, 10)
    publisher = ros.node.create_publisher(kind, 'of_test', 10)
    ros.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(message)
    ros.until(lambda: received)
    assert received == [message]


def test_subscribe_makes_a_subscription_that_no_executor_sees(ros, strings):
    """The subscription is not in the node's list, so its messages wait for its owner."""
    publisher, subscription = strings
    assert subscription not in ros.node.subscriptions
    assert subscription.topic_name == '/text'
    publisher.publish(String(data='hello'))
    for _ in range(10):
        ros.executor.spin_once(timeout_sec=0.0)
    while not (taken := take_bytes(subscription, 1)):
        time.sleep(0.001)
    assert taken[0][0] == serialize_message(String(data='hello'))


def test_incompatible_qos_counts_publishers_that_do_not_fit(ros):
    """The event reports such a publisher once, with the policy that does not fit."""
    subscription = subscribe(ros.node, String, 'text', ignore, LATCHED,
                             ros.node.default_callback_group)
    event = incompatible_qos(subscription)
    assert event.take_event().total_count_change == 0
    ros.node.create_publisher(String, 'text', QoSProfile(depth=1))
    statuses = []

    def has_changed():
        statuses.append(event.take_event())
        return statuses[-1].total_count_change

    ros.until(has_changed)
    assert qos_policy_name_from_kind(statuses[-1].last_policy_kind) == 'DURABILITY'
    assert event.take_event().total_count_change == 0
    event.destroy_when_not_in_use()
    subscription.destroy()


@pytest.mark.parametrize('by_node', [True, False])
def test_a_guard_condition_calls_before_it_is_destroyed(make_node, by_node):
    """Both `destroy_node` and `destroy_guard_condition` call the hook, and only once."""
    node, ended = make_node('ending'), []
    guard = guard_condition(node, ReentrantCallbackGroup(), lambda: ended.append(True))
    assert not ended
    if by_node:
        node.destroy_node()
    else:
        node.destroy_guard_condition(guard)
    assert ended == [True]
    node.destroy_node()
    assert ended == [True]


def test_an_executor_that_spins_until_a_future_is_done_adds_a_callback_of_its_own(ros):
    """Its module distinguishes this callback from those of users."""
    class Watched(Future):
        """A future that records the callbacks that are added."""

        def add_done_callback(self, callback):
            added.append(callback)
            super().add_done_callback(callback)

    added: list[Callable[[Future], object]] = []
    ros.executor.spin_until_future_complete(Watched(), timeout_sec=0.01)
    assert added
    assert all(map(is_of_executor, added))
    assert not is_of_executor(lambda future: None)


def test_a_wait_set_waits_for_subscriptions_and_guard_conditions(ros, strings):
    """The wait ends when one of them is ready, or after the time (ns), if it is not negative."""
    publisher, subscription = strings
    guard = GuardCondition(None, None, context=ros.context)
    wait_set = WaitSet(1, 1, 0, 0, 0, 0, ros.context.handle)

    def wait(nanoseconds):
        wait_set.clear_entities()
        wait_set.add_guard_condition(guard.handle)
        wait_set.add_subscription(subscription.handle)
        wait_set.wait(nanoseconds)
        return [bool(wait_set.get_ready_entities(kind))
                for kind in ('guard_condition', 'subscription')]

    with guard.handle, subscription.handle:
        begin = time.monotonic()
        assert wait(10**8) == [False, False]
        assert time.monotonic() - begin >= 0.09
        guard.trigger()
        assert run_in_thread(lambda: wait(-1)) == [True, False]  # no limit
        publisher.publish(String(data='hello'))
        assert run_in_thread(lambda: wait(-1)) == [False, True]


def test_an_error_of_rcl_is_a_runtime_error(ros):
    """rclpy.init raises it, and the commands in `cli` catch RuntimeError."""
    assert issubclass(RCLError, RuntimeError)
    with pytest.raises(RCLError, match=r'enclave|Enclave|context'):
        type(ros.context)().init(args=['--ros-args', '-e', 'bad'], domain_id=0)


def test_rcl_reports_the_gid_of_a_message(strings, ros):
    """The gid begins that in `get_publishers_info_by_topic`."""
    publisher, subscription = strings
    assert rcl_take() is not None
    messages: list[tuple[bytes, str, int, int]] = []
    taker = Taker(subscription)
    assert not taker.take(10)
    for text in 'one', 'two', 'three':
        publisher.publish(String(data=text))

    def has_all():
        messages.extend(taker.take(2))
        return len(messages) == 3

    ros.until(has_all)
    assert [deserialize_message(data, String).data for data, *_ in messages] == [
        'one', 'two', 'three']
    (info,) = ros.node.get_publishers_info_by_topic('text')
    assert {gid for _, gid, *_ in messages} == {bytes(info.endpoint_gid[:GID_SIZE]).hex()}
    assert all(abs(each - time.time_ns()) < 60e9 for _, _, *times in messages for each in times)


def test_a_parameter_that_the_user_has_given(make_node):
    """Its value may be the default."""
    given = make_node('given', cli_args=['--ros-args', '-p', 'use_sim_time:=false'])
    assert is_given(given, 'use_sim_time')
    assert not is_given(make_node('other'), 'use_sim_time')


def test_the_middleware_has_a_struct_for_a_subscription(strings):
    """The struct has the name of the middleware, the address of its own data, and the topic."""
    struct = rmw_subscription(strings[1].handle)
    assert struct.implementation_identifier.decode() == get_rmw_implementation_identifier()
    assert struct.topic_name == b'/text'
    assert struct.data


@pytest.mark.parametrize(
    'message', [TransformStamped(), Header(), Time(), Transform(), Vector3(), Quaternion()])
def test_generated_messages_keep_each_field_in_a_slot(message):
    """The slots are the names after an underscore, and `_check_fields`, a flag; nothing else."""
    names = {f'_{name}' for name in message.get_fields_and_field_types()}
    assert {*message.__slots__} == {*names, '_check_fields'}
    empty = object.__new__(type(message))
    for name in message.__slots__:
        setattr(empty, name, getattr(message, name))
    assert empty == message


def test_there_is_a_test_for_each_touch_point():
    """This module uses each public name that rclpy_private.py defines."""
    tree = ast.parse(Path(rclpy_private.__file__).read_text())
    names = {node.name for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    names |= {target.id for node in tree.body if isinstance(node, ast.Assign)
              for target in node.targets if isinstance(target, ast.Name)}
    assert {name for name in names if not name.startswith('_')} <= globals().keys()
