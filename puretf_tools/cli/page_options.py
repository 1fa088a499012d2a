"""The command-line options of the commands that serve a page."""

from argparse import ArgumentTypeError
import os
import re

from puretf_tools.cli.parser import Parser

HOST = '127.0.0.1'
_LAST_PORT = 65535


def add_page_options(parser: Parser) -> None:
    parser.add_argument('--host', default=HOST, metavar='ADDRESS',
                        help='serve the page at this address of the machine; 0.0.0.0: at all its '
                             'addresses (default: %(default)s, for this machine only)')
    parser.add_argument('--port', type=port_number, metavar='N',
                        help='serve the page at this port, from 1 to 65535 (default: 8080, or the '
                             'next free one)')
    parser.add_argument('--meshes', type=directory, action='append', default=[], metavar='DIR',
                        help='search for the meshes of robots below this directory: '
                             'package://PKG/a.stl is DIR/PKG/a.stl; can be given several times. '
                             'In a ROS environment, its packages are searched, too')


def port_number(text: str) -> int:
    if not (re.fullmatch('[0-9]{1,5}', text) and 1 <= int(text) <= _LAST_PORT):
        raise ArgumentTypeError(f'a port must be a number from 1 to {_LAST_PORT}, got {text!r}')
    return int(text)


def directory(text: str) -> str:
    if not os.path.isdir(text):  # Path.is_dir raises an error for a name that is too long
        raise ArgumentTypeError(f'there is no directory {text!r}')
    return text
