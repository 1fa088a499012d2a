"""The arguments of the commands that read the description of a robot from a file."""

from collections.abc import Callable, Sequence
from functools import partial
import sys
from typing import Optional

from puretf_tools.cli.parser import add_namespace_option, Parser, run, UsageError


def run_with_file(parser: Parser, command: Callable[..., int], args: Optional[Sequence[str]],
                  default: str = '') -> int:
    """
    Run a command with a file and the arguments of xacro, which rcl would take for remappings.

    :param command: gets `file`, and `arguments`: the values of the arguments by name.
    :param default: what the command reads without a file.
    """
    add_namespace_option(parser, 'use', 'tf', 'tf_static', 'joint_states', 'robot_description')
    parser.add_argument('file', nargs='?', help='a URDF file, or a .xacro file if xacro is '
                        'installed, followed by its arguments: NAME:=VALUE'
                        f'{default and f" (default: {default})"}')
    given = [*(sys.argv[1:] if args is None else args)]
    end = given.index('--ros-args') if '--ros-args' in given else len(given)
    rest = [each for each in given[:end] if ':=' not in each]
    arguments = dict(each.split(':=', 1) for each in given[:end] if ':=' in each)

    def check(options: dict[str, object]) -> None:
        if arguments and options['file'] is None:
            raise UsageError(f'{next(iter(arguments))}:=... is an argument of a .xacro file: '
                             'write the name of the file before it')

    parser.finish = check
    return run(parser, partial(command, arguments=arguments), rest + given[end:])
