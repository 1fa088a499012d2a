"""The command `param`: the parameters of a node that runs, listed, read and set."""

from argparse import ArgumentTypeError
from collections.abc import Callable, Sequence
from contextlib import suppress
import time
from typing import Any, Optional

from rcl_interfaces.msg import ParameterType, ParameterValue
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from yaml import safe_load, YAMLError

from dummy_arm.cli.node import spinning_node
from dummy_arm.cli.parser import CommandError, number, Parser, run, UsageError
from dummy_arm.cli.progress import wait
from dummy_arm.cli.signals import sleep
from dummy_arm.tf.formatting import suggest_names

#: How long a node is waited for, and its answer (s).
PATIENCE = 5.0
#: A node that was just found may not answer the first call: it is asked again after so long (s).
_ASK_AGAIN = 2.0
_STEP = 0.01  # s


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
        own = node.get_fully_qualified_name()

        def names() -> tuple[str, ...]:
            return tuple(f'{space.rstrip("/")}/{name}' for name, space
                         in node.get_node_names_and_namespaces() if not name.startswith('_'))

        if not wait(PATIENCE, f'looking for {of}', lambda: of in names()):
            others = tuple(name for name in names() if name != own)
            raise CommandError(f'there is no node {of}. ' + (
                suggest_names(of, others, 'nodes') if others else 'There is none at all: check '
                'ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE.'))
        self._client = AsyncParameterClient(node, of)
        if not wait(PATIENCE, f'looking for the services of {of}',
                    self._client.services_are_ready):
            raise CommandError(f'{of} has no services for its parameters')

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
                                       + suggest_names(name, known, 'parameters'))
        return values

    def set(self, name: str, text: str) -> None:
        """
        Set one to what is written in a text.

        :raises CommandError: when the node refuses it, with its reason.
        """
        (old,) = self.get([name])
        message = parameter(name, text, old.type)
        (result,) = self._answer(lambda: self._client.set_parameters([message])).results
        if not result.successful:
            raise CommandError(f'{self._of} refuses it: {result.reason}')

    def _answer(self, ask: Callable[[], Future]) -> Any:
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            future, ask_again = ask(), time.monotonic() + _ASK_AGAIN
            while time.monotonic() < ask_again:
                if future.done():
                    return future.result()
                sleep(_STEP)
        raise CommandError(f'{self._of} did not answer within {PATIENCE:g} s')


def parameter(name: str, text: str, type_before: int) -> Any:
    """
    Make the message that sets a parameter to what is written in a text; as `read`.

    :raises UsageError: when that is no value of a parameter.
    """
    try:
        return Parameter(name, value=read(text, type_before)).to_parameter_msg()
    except (ArgumentTypeError, OverflowError, TypeError, YAMLError) as error:
        reason = str(error).splitlines()[0]
        raise UsageError(f'{text!r} is no value of a parameter: {reason}') from None


def read(text: str, type_before: int) -> Any:
    """
    Read a value as YAML; numbers with an exponent, too.

    :param type_before: a whole number for what is a DOUBLE becomes one, and a STRING stays text.
    :raises OverflowError: when a whole number is no int64.
    :raises argparse.ArgumentTypeError: when it is a number for YAML only, and meant as a DOUBLE.
    :raises yaml.YAMLError: when it is no YAML.
    """
    if type_before == ParameterType.PARAMETER_STRING:
        return text
    value = safe_load(text)
    if isinstance(value, str):
        with suppress(ArgumentTypeError):  # YAML wants a point in what has an exponent
            return number(text)
    if isinstance(value, bool) or value is None:
        return text if value is None else value
    if isinstance(value, int) and type_before == ParameterType.PARAMETER_DOUBLE:
        return number(text)
    if isinstance(value, list) and type_before == ParameterType.PARAMETER_DOUBLE_ARRAY:
        return [part if isinstance(part, float) else number(str(part)) for part in value]
    numbers = value if isinstance(value, list) else [value]
    if any(isinstance(part, int) and not -2**63 <= part < 2**63 for part in numbers):
        raise OverflowError('a whole number must be an int64')
    return value


def _shown(value: ParameterValue) -> str:
    value = parameter_value_to_python(value)
    if value is None:
        return 'not set'
    if isinstance(value, bool):
        return str(value).lower()
    return str(value) if isinstance(value, (int, float, str)) else str(list(value))


def command(node: str, name: Optional[str] = None, value: Optional[str] = None, *,
            ros_args: Sequence[str] = ()) -> int:
    """
    Print the parameters of a node, or one of them, or set it.

    :param node: its name, with its namespace.
    :returns: the exit code.
    :raises CommandError: when there is no such node or parameter, or the node refuses the value.
    """
    with spinning_node('param', ros_args) as ours:
        parameters = Parameters(ours, f'/{node.removeprefix("/")}')
        if name is None:
            names = parameters.names()
            for known, known_value in zip(names, parameters.get(names)):
                print(f'{known}: {_shown(known_value)}')
            return 0
        if value is not None:
            parameters.set(name, value)
        print(_shown(*parameters.get([name])))
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
