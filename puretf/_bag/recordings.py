"""Which files are the parts of one recording, and in which order."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from glob import glob
from itertools import filterfalse, islice
import os
from os.path import exists, isdir
from pathlib import Path, PurePath
import re
from typing import NamedTuple, Optional, Union

from puretf._text.names import abbreviated, comma_list, SHOWN, visible

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


class BagError(Exception):
    """A bag cannot be read or has no transforms; the text says why, and what to do."""


class Recording(NamedTuple):
    """One recording: a directory, or files in order."""

    path: Path  #: the directory, or the first file that was given
    files: list[Path]  #: empty if `path` is a directory
    first: Optional[Path] = None  #: the first part of the recording, if it was not given
    warning: str = ''  #: which other files are missing
    after_missing: Sequence[Path] = ()  #: the files that do not follow another one

    @property
    def missing_part(self) -> str:
        """A sentence that names the first part, if it is not among the files; else ''."""
        how = f'read {self.first}, too.' if exists(self.first or '') else (
            f'{self.first} does not exist: rename it back, or they are lost.')
        return '' if self.first is None else visible(
            f'{self.path} is without the first part of its recording, which usually has all '
            f'static transforms: {how}')


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
        f'{files[0]}: parts of its recording are not given, or missing: '
        f'{comma_list([each.name for each in names], visible)}'),
        [file for number, file in parts.items() if number - 1 not in parts])


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
        raise BagError(f'{recording.path} cannot be read: files that its metadata.yaml lists are '
                       f'missing: {missing}; give its files in place of the directory: {rest}')
    return Recording(recording.path, files, next(filterfalse(exists, files[:1]), None))


def error_line(error: Exception) -> str:
    """Return the text of an error, or its type, in one line that ends with one period."""
    # rosbags appends the arguments of another error, as a tuple. A LookupError has only a key.
    text = '' if isinstance(error, LookupError) else ' '.join(str(error).split())
    text = visible(text.partition(": ('")[0]) or (
        f'it is not as the library that reads it expects ({type(error).__name__})')
    return f'{abbreviated(text, _LONGEST_ERROR).rstrip(".")}.'


def _listed(directory: Path) -> list[Path]:
    """Return the files that a metadata.yaml lists; raise a BagError if it cannot be read."""
    metadata = directory / 'metadata.yaml'
    if not exists(metadata):
        raise BagError(f'{directory} is not a bag: {BAG_DEFINITION}')
    from ruamel.yaml import YAML
    try:
        # The rest is not parsed: it has the types and the QoS of all topics.
        found = re.search(r'^ *relative_file_paths:(.*?)(?=^ *\w+:|\Z)',
                          metadata.read_text('utf-8', 'replace'), re.DOTALL | re.MULTILINE)
        names = YAML(typ='safe').load(found[1]) if found else None
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise ValueError('it has no list of names, relative_file_paths')
        return [directory / name for name in dict.fromkeys(PurePath(name).name for name in names)]
    except Exception as error:  # the YAML library raises errors of many types
        raise BagError(f'{directory} cannot be read: metadata.yaml: {error_line(error)} Its files '
                       'can be read without it: give them in place of the directory') from None


