"""The command `param`: list, print and set the parameters of a running node."""

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

from puretf._text.names import full_name
from puretf._text.similar_names import suggest_names
from puretf_tools.cli.node import spinning_node
from puretf_tools.cli.parser import CommandError, number, Parser, run, UsageError
from puretf_tools.cli.progress import DISCOVERY, wait
from puretf_tools.cli.signals import wait_until

#: The timeout (s) of each wait: for the node, for its services, and for each response.
PATIENCE = DISCOVERY
#: How long to wait for a response before the request is sent again (s). A node that has just been
#: discovered may not respond to the first request.
_RETRY = 2.0


class Parameters:
    def __init__(self, node: Node, remote: str) -> None:
        self._remote = remote
        own = node.get_fully_qualified_name()

        def names() -> tuple[str, ...]:
            return tuple(full_name(space, name) for name, space
                         in node.get_node_names_and_namespaces() if not name.startswith('_'))

        if not wait(PATIENCE, f'looking for {remote}', lambda: remote in names()):
            others = tuple(name for name in names() if name != own)
            raise CommandError(f'there is no node {remote}. ' + (
                suggest_names(remote, others, 'nodes') if others else 'No other node was found: '
                'check ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE.'))
        self._client = AsyncParameterClient(node, remote)
        if not wait(PATIENCE, f'looking for the services of {remote}',
                    self._client.services_are_ready):
            raise CommandError(f'{remote} has no parameter services')

    def names(self) -> list[str]:
        return sorted(self._response(lambda: self._client.list_parameters()).result.names)

    def get(self, names: list[str]) -> list[ParameterValue]:
        values = list(self._response(lambda: self._client.get_parameters(names)).values)
        if len(values) < len(names) or any(
                value.type == ParameterType.PARAMETER_NOT_SET for value in values):
            known = tuple(self.names())
            for name in names:
                if name not in known:
                    raise CommandError(f'{self._remote} has no parameter {name!r}. '
                                       + suggest_names(name, known, 'parameters'))
        return values

    def set(self, name: str, text: str) -> None:
        (current,) = self.get([name])
        message = parameter(name, text, current.type)
        (result,) = self._response(lambda: self._client.set_parameters([message])).results
        if not result.successful:
            raise CommandError(f'{self._remote} refuses the value: {result.reason}')

    def _response(self, send_request: Callable[[], Future]) -> Any:
        """Send a request, repeat it if there is no response, and return the response."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            future = send_request()
            if wait_until(_RETRY, future.done):
                return future.result()
        raise CommandError(f'{self._remote} did not respond within {PATIENCE:g} s')


def parameter(name: str, text: str, current_type: int) -> Any:
    try:
        return Parameter(name, value=read(text, current_type)).to_parameter_msg()
    except (ArgumentTypeError, OverflowError, TypeError, ValueError, YAMLError) as error:
        reason = str(error).splitlines()[0]
        raise UsageError(f'{text!r} is not a value of a parameter: {reason}') from None


def read(text: str, current_type: int) -> Any:
    """
    Convert a YAML text to a value of a parameter.

    The type of the current value decides: a STRING is the text itself, and in a DOUBLE or a
    DOUBLE_ARRAY, integers become floats.
    """
    if current_type == ParameterType.PARAMETER_STRING:
        return text
    value = safe_load(text)
    if value is None:
        return text
    if isinstance(value, str):
        with suppress(ArgumentTypeError):  # PyYAML reads 1e-3 as text
            return number(text)
    if type(value) is int and current_type == ParameterType.PARAMETER_DOUBLE:
        return number(text)
    if isinstance(value, list) and current_type == ParameterType.PARAMETER_DOUBLE_ARRAY:
        return [item if isinstance(item, float) else number(str(item)) for item in value]
    numbers = value if isinstance(value, list) else [value]
    if any(isinstance(item, int) and not -2**63 <= item < 2**63 for item in numbers):
        raise OverflowError('an integer must fit into int64')
    return value


def _value_text(value: ParameterValue) -> str:
    value = parameter_value_to_python(value)
    if value is None:
        return 'not set'
    return str(value).lower() if isinstance(value, bool) else str(value)


def command(node: str, name: Optional[str], value: Optional[str], ros_args: Sequence[str]) -> int:
    """Print the parameters of a node, or set one parameter and print its new value."""
    with spinning_node('param', ros_args) as local_node:
        parameters = Parameters(local_node, f'/{node.removeprefix("/")}')
        if name is None:
            names = parameters.names()
            for each_name, each_value in zip(names, parameters.get(names)):
                print(f'{each_name}: {_value_text(each_value)}')
            return 0
        if value is not None:
            parameters.set(name, value)
        print(_value_text(*parameters.get([name])))
    return 0


def main(args: Optional[Sequence[str]] = None) -> int:
    parser = Parser(
        'param', 'List the parameters of a running node, print one, or set one.',
        'examples: param dummy_arm\n          param dummy_arm rate\n'
        '          param dummy_arm joint_1.speed -0.5')
    parser.add_argument('node', help='name of the node, with its namespace')
    parser.add_argument('name', nargs='?', help='name of the parameter (default: all)')
    parser.add_argument('value', nargs='?', help='the new value, as YAML')
    return run(parser, command, args)
