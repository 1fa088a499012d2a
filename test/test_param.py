"""The command `param`, used on the arm."""

import math
import re
import signal

from conftest import ARM, tool
import pytest
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter

from dummy_arm.cli.parser import UsageError
from dummy_arm.tools import param as tools_param
from dummy_arm.tools.param import main, parameter, read


@pytest.fixture
def arm(start):
    """A running arm."""
    process = start(*ARM)
    process.line_with('t = 0')
    return process


@pytest.fixture
def param(start):
    """Return a function that runs the command and returns its exit code and output."""
    def run(*arguments):
        process = start(*tool('param', *arguments))
        return process.exit_code(), process.output

    return run


def test_list_read_and_set(arm, param):
    """Step 4 of the lab and the live parameters of the arm need these operations."""
    code, listed = param('dummy_arm')
    assert code == 0
    assert 'rate: 50.0\n' in listed
    assert 'joint_1.speed: 0.3\n' in listed
    assert 'frame_prefix: \n' in listed
    assert 'use_sim_time: false\n' in listed
    assert listed.splitlines() == sorted(listed.splitlines())
    assert param('dummy_arm', 'rate', '100') == (0, '100.0\n')
    assert param('/dummy_arm', 'rate') == (0, '100.0\n')
    assert param('dummy_arm', 'joint_1.speed', '-1e-3') == (0, '-0.001\n')


@pytest.mark.parametrize(('arguments', 'reason'), [
    (['rate', '0'], '/dummy_arm refuses the value: .*[Rr]ate.*0.1.*10000'),
    (['rate', 'fast'], '/dummy_arm refuses the value: rate must be a number .*fast'),
    (['frame_prefix', 'left/'], '/dummy_arm refuses the value: .*read-only'),
    (['joint_1.sped'], "/dummy_arm has no parameter 'joint_1.sped'. Nearest known: "
                       "'joint_1.speed'"),
    (['colour', 'red'], "/dummy_arm has no parameter 'colour'. Known parameters: .*and 8 more"),
])
def test_what_cannot_be_done_is_exit_code_1_with_the_reason(arm, param, arguments, reason):
    """The line has the reason that the node gives, or the names of existing parameters."""
    code, output = param('dummy_arm', *arguments)
    assert code == 1
    assert re.fullmatch(f'param: {reason}.*\n', output)


def test_no_such_node(arm, param):
    """The line names the node with the nearest name."""
    code, output = param('dumy_arm')
    assert (code, output) == (
        1, "param: there is no node /dumy_arm. Nearest known: '/dummy_arm'.\n")


def test_no_node_at_all(failed, monkeypatch, domain_id):
    """The line says which settings to check."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain_id))
    monkeypatch.setattr(tools_param, 'PATIENCE', 0.5)
    code, line = failed(main, 'dummy_arm')
    assert code == 1
    assert re.fullmatch('param: there is no node /dummy_arm.*ROS_DOMAIN_ID.*\n', line)


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


@pytest.mark.parametrize('arguments', [[], ['a', 'b', 'c', 'd'], ['dummy_arm', '--rate']])
def test_wrong_use_is_one_line_and_exit_code_2(failed, arguments):
    """The line ends with the usage."""
    code, line = failed(main, *arguments)
    assert code == 2
    assert re.fullmatch(r'param: .*usage: param \[-h\] node \[name\] \[value\]\n', line)


def test_ctrl_c_while_it_looks_for_a_node(start, ros):
    """Ctrl-C is a normal end: exit code 0, and no output."""
    process = start(*tool('param', 'nobody', '--ros-args', '--log-level', 'info'))
    ros.until(lambda: len(ros.node.get_node_names()) > 1)
    process.end(signal.SIGINT)
    assert process.exit_code() == 0
    assert process.output == ''
