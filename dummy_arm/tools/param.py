"""The command `param`: the parameters of a node that runs, listed, read and set."""

from collections.abc import Callable, Sequence
import time
from typing import Any, Optional

from rcl_interfaces.msg import ParameterType, ParameterValue
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import get_parameter_value, Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

from dummy_arm.command import CommandError, Parser, run
from dummy_arm.node_command import ros
from dummy_arm.tf.hints import nearest
from dummy_arm.tools.waiting import wait

#: How long a node is waited for, and its answer (s).
PATIENCE = 5.0
#: A node that was just found may not answer the first call: it is asked again after so long (s).
_ASK_AGAIN = 1.0
_LONGEST_WAIT = 0.1  # s; a signal does not end a wait in the middleware


class Parameters:
    """The parameters of another node."""

    def __init__(self, node: Node, of: str) -> None:
        """
        Find the node.

        :param node: a node of our own, by which the other is asked.
        :param of: the other node's full name.
        :raises CommandError: when there is none, or it does not tell its parameters.
        """
        self._of = of
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        own = node.get_fully_qualified_name()

        def names() -> tuple[str, ...]:
            return tuple(f'{space.rstrip("/")}/{name}' for name, space
                         in node.get_node_names_and_namespaces() if not name.startswith('_'))

        if not wait(PATIENCE, f'looking for {of}', lambda: of in names()):
            others = tuple(name for name in names() if name != own)
            raise CommandError(f'there is no node {of}. ' + (
                nearest(of, others, 'nodes') if others else 'There is none at all: check '
                'ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE.'))
        self._client = AsyncParameterClient(node, of)
        if not wait(PATIENCE, f'looking for the services of {of}',
                    self._client.services_are_ready):
            raise CommandError(f'{of} has no services for its parameters')

    def end(self) -> None:
        """Ask no more."""
        self._executor.shutdown()

    def names(self) -> list[str]:
        """List their names."""
        return sorted(self._answer(lambda: self._client.list_parameters()).result.names)

    def get(self, names: list[str]) -> list[ParameterValue]:
        """
        Read their values.

        :raises CommandError: when there is no parameter of one of the names.
        """
        values = list(self._answer(lambda: self._client.get_parameters(names)).values)
        if len(values) < len(names) or any(
                value.type == ParameterType.PARAMETER_NOT_SET for value in values):
            known = tuple(self.names())
            for name in names:
                if name not in known:
                    raise CommandError(f'{self._of} has no parameter {name!r}. '
                                       + nearest(name, known, 'parameters'))
        return values

    def set(self, name: str, text: str) -> None:
        """
        Set one to what is written in a text.

        :raises CommandError: when the node refuses it, with its reason.
        """
        (old,) = self.get([name])
        message = Parameter(name, value=_read(text, old.type)).to_parameter_msg()
        (result,) = self._answer(lambda: self._client.set_parameters([message])).results
        if not result.successful:
            raise CommandError(f'{self._of} refuses it: {result.reason}')

    def _answer(self, ask: Callable[[], Future]) -> Any:
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            future, ask_again = ask(), time.monotonic() + _ASK_AGAIN
            while time.monotonic() < ask_again:
                self._executor.spin_once_until_future_complete(future, _LONGEST_WAIT)
                if future.done():
                    return future.result()
        raise CommandError(f'{self._of} did not answer within {PATIENCE:g} s')


def _read(text: str, type_before: int) -> Any:
    """
    Read a value as YAML; numbers with an exponent, too.

    :param type_before: a whole number for what is a DOUBLE becomes one, and a STRING stays text.
    """
    if type_before == ParameterType.PARAMETER_STRING:
        return text
    value = parameter_value_to_python(get_parameter_value(text))
    is_number = isinstance(value, (int, str)) and not isinstance(value, bool)
    if is_number and (isinstance(value, str) or type_before == ParameterType.PARAMETER_DOUBLE):
        try:
            return float(text)
        except ValueError:
            pass
    return value


def _shown(value: ParameterValue) -> str:
    value = parameter_value_to_python(value)
    if isinstance(value, bool):
        return str(value).lower()
    return str(value) if isinstance(value, (int, float, str)) else str(list(value or []))


def command(node: str, name: Optional[str] = None, value: Optional[str] = None, *,
            ros_args: Sequence[str] = ()) -> int:
    """
    Print the parameters of a node, or one of them, or set it.

    :param node: its name, with its namespace.
    :returns: the exit code.
    :raises CommandError: when there is no such node or parameter, or the node refuses the value.
    """
    with ros(ros_args):
        parameters = Parameters(rclpy.create_node('param'), f'/{node.removeprefix("/")}')
        try:
            if name is None:
                names = parameters.names()
                for known, known_value in zip(names, parameters.get(names)):
                    print(f'{known}: {_shown(known_value)}')
                return 0
            if value is not None:
                parameters.set(name, value)
            print(_shown(*parameters.get([name])))
        finally:
            parameters.end()
    return 0


def main(args: Optional[Sequence[str]] = None) -> int:
    """Run the command; see `--help`."""
    parser = Parser(
        'param', 'List the parameters of a node that runs, print one, or set one.',
        'examples: param dummy_arm\n          param dummy_arm rate\n'
        '          param dummy_arm joint_1.speed -0.5')
    parser.add_argument('node', help='the name of the node, with its namespace')
    parser.add_argument('name', nargs='?', help='the parameter; without it all are listed')
    parser.add_argument('value', nargs='?', help='what it is set to, as YAML')
    return run(parser, command, args)
