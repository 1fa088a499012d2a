"""The text of a description: from a file, expanded by xacro, and as a tree of XML elements."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from math import isfinite
import os
from pathlib import Path
import re
import shlex
from typing import NoReturn, Optional, Union
from xml.etree import ElementTree
from xml.parsers import expat

from puretf._text.distribution import distribution
from puretf._text.names import abbreviated, quoted, visible
from puretf_tools.cli.parser import UsageError

#: The longest text that is parsed (characters or bytes).
MAX_SIZE = 10_000_000

_BLANKS = ' \t\r\n'
_NUMBER = re.compile(r'[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?', re.ASCII)
_LONGEST_NUMBER, _WORDS = 100, {3: 'three', 4: 'four'}

#: Comments, CDATA and instructions: urdfdom accepts -- in a comment, and a declaration after
#: blanks. A group matches what is not closed.
_NO_ELEMENT = re.compile(
    r'<!--(?:.*?-->|(.*))|<!\[CDATA\[(?:.*?\]\]>|(.*))|<\?(?:.*?\?>|(.*))', re.DOTALL)
#: What follows an error of xacro, by its text.
_XACRO_HINTS = {
    'declaration not at start': '; remove what stands before <?xml',
    'not well-formed': '; if it is in a comment, remove -- from its text',
    'unbound prefix': '; declare it in <robot>: xmlns:PREFIX="..."',
    r'\$\(dirname\)': "; leave out '$(dirname)/': names are relative to the file",
    r'Undefined substitution argument (\w+)': r'; write {file} \1:=VALUE',
    'package .* not found|ament_index_python|AMENT_PREFIX_PATH':
        '; in place of $(find PACKAGE), write a path relative to the file, or install the package '
        'and source the setup file of its workspace'}


class DescriptionError(UsageError):
    """A description that is refused; the text is one line."""


def read(path: Union[str, os.PathLike[str]], arguments: Mapping[str, str] = {}) -> str:
    """
    Return the text of a URDF file, expanded by xacro if it is a .xacro file.

    Elements of xacro in another file are expanded if that is possible.

    :param arguments: the values of the arguments of a .xacro file.
    :raises DescriptionError: if the file cannot be read or expanded.
    """
    name = os.fspath(path)
    try:
        with Path(path).open('rb') as file:
            text = file.read(4 * MAX_SIZE + 1).decode()  # a character has up to 4 bytes
    except OSError as error:
        hint = ': this is the text of a file; write its name' * name.lstrip().startswith('<')
        refuse(f'cannot read {abbreviated(name, 300)}: {error.strerror or error}{hint}')
    except UnicodeDecodeError:
        refuse(f'cannot read {name}: it is not text in UTF-8: save it in this encoding')
    if Path(path).suffix == '.xacro':
        return _expand(name, arguments)
    if '<xacro:' in _NO_ELEMENT.sub('', text):
        with suppress(DescriptionError):  # then `parse` ignores them, like urdfdom
            return _expand(name, arguments)
    if arguments:
        refuse(f'{name} has no arguments, since it is not a file *.xacro: leave out '
               f'{(first := next(iter(arguments)))}:=..., or write --ros-args -r {first}:=... if '
               'it remaps a name')
    return text or refuse(f'cannot read {name}: it is empty')


def refuse(text: str) -> NoReturn:
    raise DescriptionError(visible(' '.join(text.split()))) from None


def _expand(path: str, arguments: Mapping[str, str]) -> str:
    try:
        import xacro
    except ImportError:
        refuse(f'cannot read {path}: xacro is missing: '
               f'pip install xacro, or apt install ros-{distribution()}-xacro')
    try:
        return str(xacro.process_file(path, mappings={**arguments}).toxml())
    except Exception as error:  # a macro is a program: any error is possible
        text = str(error) or type(error).__name__
        where = ', included from '.join(reversed(xacro.filestack)) or path
        if xacro.macrostack:
            macro = xacro.macrostack[-1]
            where = (f'macro {macro.body.getAttribute("name")} of {macro.history[-1][-1]}, '
                     f'used in {where}')
    # xacro repeats the text of an error that is not its own.
    text = re.sub(r"^<class '[\w.]+'>: (.*) \1$", r'\1', text, flags=re.DOTALL)
    hint = next((found.expand(hint).format(file=shlex.quote(path))
                 for pattern, hint in _XACRO_HINTS.items() if (found := re.search(pattern, text))),
                '')
    refuse(f'xacro cannot expand {where}: {abbreviated(text, 500)}{hint}')


def robot_element(text: str) -> ElementTree.Element:
    """Parse the XML and check the element <robot> itself."""
    if len(text) > MAX_SIZE:
        refuse(f'the robot description is too long: at most {MAX_SIZE} characters are allowed')
    if not (given := text.strip('\ufeff' + _BLANKS)).startswith('<'):
        refuse(f'the robot description must be the text of a URDF, which begins with <, got '
               f'{quoted(given)}; robot_state_publisher FILE takes a file, URDF or xacro')
    try:
        robot = _xml(_source(text))
    except (expat.ExpatError, UnicodeError) as error:
        refuse(f'the robot description is not valid XML: {error}')
    if robot.tag != 'robot':
        hint = ', which is SDF, not URDF' if robot.tag == 'sdf' else ''
        refuse(f'the outermost element must be <robot>, got <{abbreviated(robot.tag)}>{hint}')
    if robot.get('name') is None:
        refuse('the robot has no name: write <robot name="...">')
    if robot.get('version', '1.0') != '1.0':
        refuse(f'the version of the robot must be 1.0, got {quoted(robot.attrib["version"])}')
    return robot


def attribute(element: Optional[ElementTree.Element], tag: str, name: str, what: str) -> str:
    """Return the text of an attribute that an element with a tag must have."""
    text = None if element is None else element.get(name)
    return refuse(f'{what} has no {tag}: write <{tag} {name}="..."/>') if text is None else text


def numbers(element: ElementTree.Element, name: str, what: str, count: int,
            default: Optional[Sequence[float]] = None) -> Sequence[float]:
    """Return the numbers in an attribute; without a default, there must be some."""
    value = element.get(name)
    if value is None:
        return default or refuse(f'{what}: <{element.tag}> has no {name}: write {name}="..."')
    texts = re.split(f'[{_BLANKS}]+', value.strip(_BLANKS))
    if len(texts) != count or not all(map(_is_number, texts)):
        needed = f'{_WORDS[count]} numbers with blanks between them' if count > 1 else 'a number'
        refuse(f'{what}: {name} of <{element.tag}> must be {needed}, got {quoted(value)}'
               + '; it is xacro: put it into a file *.xacro' * ('${' in value))
    return [*map(float, texts)]


def _is_number(text: str) -> bool:
    return (len(text) <= _LONGEST_NUMBER and _NUMBER.fullmatch(text) is not None
            and isfinite(float(text)))


def _source(text: str) -> str:
    """
    Return a text with its elements only, in the same lines.

    Refuse what makes a short text long, by entities or default attributes, for any parser.
    """
    # The blank keeps what stands before and behind from becoming a comment together.
    text = _NO_ELEMENT.sub(lambda found: found[0] if found.lastindex else (
        ' ' + '\n' * found[0].count('\n')), text)
    if text.lstrip('\ufeff' + _BLANKS).startswith('<!DOCTYPE'):
        refuse('the robot description has a <!DOCTYPE, which is not allowed, since it can make a '
               'short text endless: remove it, and write the text of each entity in its place')
    return text.lstrip('\ufeff')


def _xml(text: str) -> ElementTree.Element:
    """Parse XML without namespaces, like urdfdom: they would put their URI into each name."""
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.Parse(text, True)
    return builder.close()
