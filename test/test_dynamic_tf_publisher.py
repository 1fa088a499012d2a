"""The command `dynamic_tf_publisher`; test_lab.py tests what it publishes."""

import re

from conftest import tool
import pytest

NAME = 'dynamic_tf_publisher'


@pytest.mark.parametrize(('arguments', 'message'), [
    (['-p', 'rotation:=x'], "rotation must be one of identity, quaternion, euler, got 'x'"),
    (['-p', 'rotation:=1'], 'rotation must be one of identity, quaternion, euler, got 1'),
    (['-p', 'roll:=.nan'], r'roll must be a finite number \(rad\), got nan'),
    (['-p', 'yaw:=left'], r"yaw must be a finite number \(rad\), got 'left'"),
    (['-p', 'yaw:=true'], r'yaw must be a finite number \(rad\), got True'),
])
def test_a_bad_start_is_one_line_and_exit_code_2(start, arguments, message):
    """The line names the parameter and the values that are allowed."""
    process = start(*tool(NAME, '--ros-args', *arguments))
    assert process.exit_code() == 2
    assert re.fullmatch(f'{NAME}: {message}\n', process.output)


@pytest.mark.parametrize(('name', 'value'), [
    ('rotation', 'euler angles'), pytest.param('pitch', 'up', marks=pytest.mark.soak),
    pytest.param('roll', '.inf', marks=pytest.mark.soak)])
def test_bad_values_are_refused_while_it_runs(start, name, value):
    """After a refusal, the parameters keep their values."""
    start(*tool(NAME, '--ros-args', '-p', 'rotation:=euler', '-p', 'roll:=1')).line_with('euler')
    setting = start(*tool('param', NAME, name, value))
    assert setting.exit_code() == 1
    assert re.fullmatch(f'param: /{NAME} refuses the value: {name} must be .*\n', setting.output)
    reading = start(*tool('param', NAME, 'rotation'))
    assert reading.exit_code() == 0
    assert reading.output == 'euler\n'


def test_help(start):
    """The help lists the parameters, and has an example."""
    process = start(*tool(NAME, '--help'))
    assert process.exit_code() == 0
    for text in ('rotation ', 'identity', 'quaternion', 'euler', 'roll, pitch, yaw', 'example: '):
        assert text in process.output
