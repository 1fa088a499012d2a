"""The command `param`, used on a node of the test and on the arm."""

import math
import re

from cli_runner import call
from processes import TIMEOUT
import pytest
from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rclpy.parameter import Parameter

from puretf_tools.cli.parser import UsageError
from puretf_tools.commands import param as tools_param
from puretf_tools.commands.param import main, parameter, read


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """Wait as long as the other tests do."""
    monkeypatch.setattr(tools_param, 'PATIENCE', TIMEOUT)


@pytest.fixture
def fails_with(monkeypatch, ros):
    """Call the command with ever more patience until it fails with a text; return its stderr."""
    def run(text, *arguments):
        for patience in 0.3, 3.0, 30.0:
            monkeypatch.setattr(tools_param, 'PATIENCE', patience)
            code, output, error = call(main, *arguments, domain=ros.domain)
            assert (code, output) == (1, '')
            if text in error:
                return error
        pytest.fail(error)

    return run


def test_list(ros):
    """Values are written as in YAML; the names are sorted."""
    for name, value in (('rate', 50.0), ('fast', False), ('name', ''), ('count', 3),
                        ('numbers', [1.5, 2.0]), ('words', ['a', 'b'])):
        ros.node.declare_parameter(name, value)
    ros.node.declare_parameter('nothing', None, ParameterDescriptor(dynamic_typing=True))
    with ros.spinning():
        code, listed, error = call(main, 'test', domain=ros.domain)
    assert (code, error) == (0, '')
    assert [line for line in listed.splitlines() if 'start_type' not in line] == [
        'count: 3', 'fast: false', 'name: ', 'nothing: not set', 'numbers: [1.5, 2.0]',
        'rate: 50.0', 'use_sim_time: false', "words: ['a', 'b']"]


def test_read(arm_domain):
    """The name of a node may begin without a slash."""
    assert call(main, 'dummy_arm', 'rate', domain=arm_domain) == (0, '50.0\n', '')


def test_set(ros):
    """The value is read for the type of the parameter; the new value is printed."""
    ros.node.declare_parameter('rate', 50.0)
    with ros.spinning():
        assert call(main, '/test', 'rate', '-1e2', domain=ros.domain) == (
            0, '-100.0\n', '')
    assert ros.node.get_parameter('rate').value == -100.0


@pytest.mark.parametrize(('arguments', 'reason'), [
    (['rate', '0'], '/dummy_arm refuses the value: .*[Rr]ate.*0.1.*10000'),
    (['rate', 'fast'], '/dummy_arm refuses the value: rate must be a number .*fast'),
    (['frame_prefix', 'left/'], '/dummy_arm refuses the value: .*read-only'),
    (['joint_1.sped'], "/dummy_arm has no parameter 'joint_1.sped'. Nearest known: "
                       "'joint_1.speed'"),
    (['colour', 'red'], "/dummy_arm has no parameter 'colour'. Known parameters: .*and 11 more"),
])
def test_what_cannot_be_done_is_exit_code_1_with_the_reason(arm_domain, arguments, reason):
    """The line has the reason that the node gives, or the names of existing parameters."""
    code, output, error = call(main, 'dummy_arm', *arguments, domain=arm_domain)
    assert (code, output) == (1, '')
    assert re.fullmatch(f'param: {reason}.*\n', error)


def test_no_such_node(fails_with):
    """The line names the node with the nearest name, but not that of the command."""
    assert fails_with('Nearest', 'tets') == (
        "param: there is no node /tets. Nearest known: '/test'.\n")


def test_no_node_at_all(monkeypatch, domain_id):
    """The line says which settings to check."""
    monkeypatch.setattr(tools_param, 'PATIENCE', 0.1)
    code, output, error = call(main, 'dummy_arm', domain=domain_id)
    assert (code, output) == (1, '')
    assert re.fullmatch('param: there is no node /dummy_arm.*ROS_DOMAIN_ID.*\n', error)


def test_a_node_without_services(make_node, fails_with):
    """It is there, but its parameters cannot be read."""
    make_node('silent', start_parameter_services=False)
    assert fails_with('services', 'silent') == 'param: /silent has no parameter services\n'


def test_a_node_that_does_not_respond(monkeypatch, fails_with):
    """It is not spun."""
    monkeypatch.setattr(tools_param, '_RETRY', 0.1)
    assert fails_with('respond', 'test').startswith('param: /test did not respond within ')


@pytest.mark.parametrize(('text', 'before', 'value'), [
    ('-7', 1, -7), ('3', 1.5, 3.0), ('1e-3', 1.5, 0.001), ('-1e3', 1, -1000.0), ('54', 'a', '54'),
    ('on', 'a', 'on'), ('', 'a', ''), ('a: b', 'a', 'a: b'), ('true', False, True),
    ('[3, -4]', [1], [3, -4]), ('[x, y z]', ['a'], ['x', 'y z']),
    ('[1.5, 2.0]', [0.5], [1.5, 2.0]),
    ('fast', 1.5, 'fast'), ('7', True, 7), ('2.5', 1, 2.5), ('.inf', 1.5, math.inf),
    ('[1e-3, 2]', [0.5], [0.001, 2.0])])
def test_values_are_read_as_yaml_and_for_the_type_that_was_there(text, before, value):
    """Text may look like a number; an exponent needs no decimal point, unlike in YAML."""
    found = read(text, Parameter('name', value=before).get_parameter_value().type)
    assert (type(found), found) == (type(value), value)


@pytest.mark.parametrize(('text', 'reason'), [
    ('0x10', "'0x10' is not a number"), ('1:30', "'1:30' is not a number"),
    ('1_0', "'1_0' is not a number"), ("'abc", 'while scanning'), ('@x', 'while scanning'),
    ('*a', 'found undefined alias'), ('{a: 1}', 'not one of the allowed types'),
    ('2024-01-01', 'not one of the allowed types'), ('2024-13-01', 'month must be in'),
    ('!!python/object:os.system x', 'could not determine a constructor'),
    ('[99999999999999999999]', 'must fit into int64')])
def test_what_is_no_value_is_a_wrong_use(text, reason):
    """The error has the reason, in one line."""
    with pytest.raises(UsageError, match=f'is not a value of a parameter: .*{reason}') as error:
        parameter('rate', text, ParameterType.PARAMETER_DOUBLE)
    assert '\n' not in str(error.value)
