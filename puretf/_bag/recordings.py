"""Which files are the parts of one recording, and in which order."""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from glob import glob
from itertools import filterfalse, islice
import os
from os.path import exists, isdir
from pathlib import Path, PurePath
import re
from typing import Any, NamedTuple, Optional, Union

from puretf._text.names import abbreviated, comma_list, shortened, SHOWN, visible

#: One path, or several: files, directories, and patterns such as `*.mcap`.
Paths = Union[str, 'os.PathLike[str]', Iterable[Union[str, 'os.PathLike[str]']]]

BAG_DEFINITION = ('a bag is a directory written by ros2 bag record, a .mcap or .db3 file in it, '
                  'or a .bag file of ROS 1')
_ENDING = r'(\.(?:mcap|db3|bag))(?:\.zstd)?'
_FILE = re.compile(f'{_ENDING}$')
#: The name of a part of a split recording: rosbag2 writes `name_0.mcap`, `name_1.mcap` and so on.
#: A name that ends with a time is none: without a name, rosbag of ROS 1 begins each part with it.
_PART = re.compile(rf'.*(?<!-\d\d-\d\d-\d\d)_(0|[1-9]\d*){_ENDING}')
#: The largest number of characters of an error of a library.
_LONGEST_ERROR = 500
#: The largest size of metadata (bytes), and the largest numbers of values one within another, and
#: up to the end of the list of files.
_LONGEST, _DEEPEST, _MOST_VALUES = 1_000_000, 20, 20_000


class BagError(Exception):
    """A bag cannot be read or has no transforms; the text says why, and what to do."""


class Recording(NamedTuple):
    """One recording: a directory, or files in order."""

    path: Path  #: the directory, or the first file that was given
    files: list[Path]  #: empty if `path` is a directory
    first: Optional[Path] = None  #: the first part of the recording, if it was not given
    warning: str = ''  #: which other files are missing


def recordings(paths: Paths) -> list[Recording]:
    """Sort the files that some paths name into recordings, in the order of the paths."""
    given = [paths] if isinstance(paths, (str, os.PathLike)) else paths
    listed: dict[Path, list[Path]] = {}  # by directory
    found: dict[Path, dict[int, Path]] = {}  # by recording: the parts, or at -1 the directory
    for path in (bag for text in given for bag in _bags(str(text))):
        folder, key, number = path.parent, path, 0
        if folder not in listed:
            listed[folder] = []
            with suppress(BagError, ImportError):  # the files can be read without metadata
                listed[folder] = _listed(folder)
        if isdir(path):
            number = -1
        elif path in listed[folder]:
            key, number = folder, listed[folder].index(path)
        elif not listed[folder] and (match := _PART.fullmatch(path.name)):
            number, first = int(match[1]), _part(path, 0)
            key = first if exists(first) else path
        found.setdefault(key.absolute(), {})[number] = path
    return [Recording(parts[-1], []) if -1 in parts else
            _of_files(parts, listed[next(iter(parts.values())).parent])
            for parts in found.values()]


def _of_files(parts: dict[int, Path], listed: list[Path]) -> Recording:
    files = [file for _, file in sorted(parts.items())]
    lacking = [*islice((number for number in range(min(parts), max(parts)) if number not in parts),
                       SHOWN + 1)]
    first, *names = [listed[each] if files[0] in listed else _part(files[0], each)
                     for each in (0, *lacking)]
    return Recording(files[0], files, None if 0 in parts else first, '' if not lacking else (
        f'{files[0]}: parts of its recording are not given: '
        f'{comma_list([each.name for each in names], visible)}'))


def _part(path: Path, number: int) -> Path:
    """Return another part of the recording of a file; each may be compressed as a whole."""
    plain = path.with_name(re.sub(r'_\d+(\.\w+)(\.zstd)?$', rf'_{number}\1', path.name))
    packed = Path(f'{plain}.zstd')
    return packed if exists(packed) else plain


def is_bag(path: str) -> bool:
    """Return whether a text is the path of a bag, and not the name of a frame."""
    with suppress(OSError):  # such as a directory that cannot be read
        return bool(_FILE.search(path) or _is_pattern(path) or _bags_in(Path(path))
                    or (os.path.dirname(path) and os.path.lexists(path)))
    return True


def _bags(text: str) -> list[Path]:
    """Return what a path or a pattern names: files, and directories with a metadata.yaml."""
    matches = filter(_is_named_bag, map(Path, glob(text))) if _is_pattern(text) else [Path(text)]
    paths = {path.parent if path.name == 'metadata.yaml' else path for path in matches}
    return [bag for path in sorted(paths) for bag in _bags_in(path) or [path]] or [Path(text)]


def _is_pattern(text: str) -> bool:
    return bool(re.search(r'[*?[]', text)) and not os.path.lexists(text)


def _is_named_bag(path: Path) -> bool:
    return bool(_FILE.search(path.name) or path.name == 'metadata.yaml'
                or exists(path / 'metadata.yaml'))


def _bags_in(directory: Path) -> list[Path]:
    """Return the bags in a directory, or the directory if it is one."""
    return [directory] if exists(directory / 'metadata.yaml') else sorted(
        filter(_is_named_bag, directory.iterdir() if isdir(directory) else ()))


def resolved(recording: Recording) -> Recording:
    """Return a recording with the files that the metadata.yaml of its directory lists."""
    if recording.files:
        return recording
    files = _listed(recording.path)
    others = [each.name for each in sorted(recording.path.iterdir()) if _FILE.search(each.name)]
    if others and not any(map(exists, files)):
        missing, rest = (comma_list(names, visible)
                         for names in ([each.name for each in files], others))
        remedy = ('is not listed: give this file' if len(others) == 1 else
                  'are not listed: give these files')
        raise BagError(f'{recording.path} cannot be read: files that its metadata.yaml lists are '
                       f'missing: {missing}; {rest} {remedy}')
    return Recording(recording.path, files, next(filterfalse(exists, files[:1]), None))


def error_line(error: Exception) -> str:
    """Return the text of an error, or its type, in one line that ends with one period."""
    text = visible(' '.join(str(error).split())) or (
        f'it is not as the library that reads it expects ({type(error).__name__})')
    return f'{abbreviated(text, _LONGEST_ERROR).rstrip(".")}.'


def _listed(directory: Path) -> list[Path]:
    """Return the files that a metadata.yaml lists; raise a BagError if it cannot be read."""
    metadata = directory / 'metadata.yaml'
    if not exists(metadata):
        raise BagError(f'{directory} is not a bag: {BAG_DEFINITION}')
    from ruamel.yaml import YAML
    try:
        with metadata.open('rb') as file:
            data = file.read(_LONGEST + 1)
        if len(data) > _LONGEST:
            raise ValueError(f'it has more than {_LONGEST} bytes')
        return [directory / name for name in _names(
            islice(YAML(typ='safe').parse(data.decode(errors='replace')), _MOST_VALUES))]
    except Exception as error:  # the YAML library raises errors of many types
        raise BagError(f'{directory} cannot be read: metadata.yaml: {error_line(error)} Its files '
                       'can be read without it: give them in place of the directory') from None


def _names(events: Iterator[Any]) -> Iterable[str]:
    """
    Return the names of the files that metadata list, from the first events of the YAML parser.

    What else metadata have is not loaded, which can take minutes for a megabyte of YAML.
    """
    depth, last = 0, ''
    for event in events:
        kind = type(event).__name__
        if getattr(event, 'version', None):
            raise ValueError('it has a directive %YAML')
        if last == 'relative_file_paths' and kind == 'SequenceStartEvent':
            break
        depth += kind.endswith('StartEvent') - kind.endswith('EndEvent')
        if depth > _DEEPEST:
            raise ValueError(f'more than {_DEEPEST} values are one within another')
        last = getattr(event, 'value', '')
    names: dict[str, None] = {}
    for event in events:
        if type(event).__name__ == 'SequenceEndEvent':
            return names
        if not isinstance(name := getattr(event, 'value', None), str):
            raise ValueError('relative_file_paths has an entry that is no name')
        if (name := PurePath(name).name) in names:
            raise ValueError(f'it lists {shortened(name)} more than once')
        names[name] = None
    raise ValueError(f'no whole list relative_file_paths is in its first {_MOST_VALUES} values')
