"""Which files are the parts of one recording, and in which order."""

from collections.abc import Iterable
from contextlib import suppress
from glob import glob
from itertools import islice
import os
from pathlib import Path, PurePath
import re
from typing import NamedTuple, Optional, Union

from puretf._bag.formats import BAG_DEFINITION, BagError, refuse_special
from puretf._core.texts import comma_list, error_line, later_part, visible
from puretf._wire.definitions import checked_yaml, LONGEST_YAML

#: One path, or several: files, directories, and patterns such as `*.mcap`.
Paths = Union[str, 'os.PathLike[str]', Iterable[Union[str, 'os.PathLike[str]']]]

_FILE = re.compile(r'\.(mcap|db3|bag)(\.zstd)?$')
#: The name of a part of a split recording: rosbag2 writes `name_0.mcap`, `name_1.mcap` and so on.
_PART = re.compile(r'(.*)_(0|[1-9]\d*)(\.(?:mcap|db3|bag))(?:\.zstd)?')
#: The time in the name of each part if rosbag of ROS 1 was not given a name.
_TIME = re.compile(r'\d{4}(-\d\d){5}$')
#: The largest number of files that the text of an error lists.
_SHOWN = 5


class Recording(NamedTuple):
    """One recording: a directory, or files in order."""

    path: Path  #: the directory, or the first file that was given
    files: list[Path]  #: empty if `path` is a directory
    first: Optional[Path] = None  #: the first part of the recording, if it was not given
    warning: str = ''  #: which files are missing, or what is wrong with the directory

    @property
    def missing_part(self) -> str:
        """A sentence that names the first part, if it was not given; else ''."""
        return later_part(str(self.path), str(self.first)) if self.first else ''


def recordings(paths: Paths) -> list[Recording]:
    """Sort the files that some paths name into recordings, in the order of the paths."""
    given = [paths] if isinstance(paths, (str, os.PathLike)) else [*paths]
    found: dict[str, Recording] = {}
    parts: dict[str, dict[int, Path]] = {}
    listed: dict[Path, list[Path]] = {}
    for path in (bag for text in given for bag in _bags(str(text))):
        if os.path.isdir(path):
            found[os.path.abspath(path)] = Recording(path, [])
            continue
        first, number = _part(path, listed)
        key = os.path.abspath(path.parent if first in listed[path.parent] else
                              first if os.path.exists(first) else path)
        if key not in found or found[key].files:
            parts.setdefault(key, {})[number] = path
            files = [file for _, file in sorted(parts[key].items())]
            found[key] = Recording(files[0], files, None if 0 in parts[key] else first,
                                   _between(parts[key], listed[path.parent]))
    return [*found.values()]


def _between(parts: dict[int, Path], listed: list[Path]) -> str:
    """Return a warning that names the parts between those that are given; '' if there are none."""
    lacking = [*islice((number for number in range(min(parts), max(parts)) if number not in parts),
                       _SHOWN + 1)]
    if not lacking:
        return ''
    last = parts[max(parts)]
    names = [listed[number].name if last in listed else
             re.sub(r'_\d+(\.\w+(\.zstd)?)$', rf'_{number}\1', last.name) for number in lacking]
    return (f'{parts[min(parts)]}: parts of its recording are not given: '
            f'{comma_list(names, _SHOWN, visible)}')


def is_bag(path: str) -> bool:
    """Return whether a text is the path of a bag, and not the name of a frame."""
    with suppress(OSError):  # such as a directory that cannot be read
        return bool(_FILE.search(path) or _is_pattern(path) or _bags_in(Path(path))
                    or (os.path.dirname(path) and os.path.lexists(path)))
    return True


def _bags(text: str) -> list[Path]:
    """Return what a path or a pattern names: files, and directories with a metadata.yaml."""
    if not text:
        return []
    matches = filter(_is_named_bag, map(Path, glob(text))) if _is_pattern(text) else [Path(text)]
    paths = {path.parent if path.name == 'metadata.yaml' else path for path in matches}
    return [bag for path in sorted(paths, key=_natural)
            for bag in _bags_in(path) or [path]] or [Path(text)]


def _is_pattern(text: str) -> bool:
    return bool(re.search(r'[*?[]', text)) and not os.path.lexists(text)


def _is_named_bag(path: Path) -> bool:
    return bool(_FILE.search(path.name)) or path.name == 'metadata.yaml' or os.path.exists(
        path / 'metadata.yaml')


def _bags_in(directory: Path) -> list[Path]:
    """Return the bags in a directory, or the directory if it is one; in the order of numbers."""
    if os.path.exists(directory / 'metadata.yaml'):
        return [directory]
    return sorted((path for path in directory.iterdir() if _is_named_bag(path)), key=_natural) if (
        os.path.isdir(directory)) else []


def _natural(path: Path) -> list[str]:
    return [part.zfill(20) if part.isdigit() else part for part in re.split(r'(\d+)', str(path))]


def resolved(recording: Recording, partial: bool) -> Recording:
    """Find the files; `partial`: some may be missing, and a metadata.yaml may be damaged."""
    directory = recording.path
    if recording.files:
        return recording
    if not os.path.exists(directory / 'metadata.yaml'):
        raise BagError(f'{directory} is not a bag: {BAG_DEFINITION}')
    warning = ''
    try:
        files = _listed(directory)
    except BagError as error:
        files = sorted((path for path in directory.iterdir() if _FILE.search(path.name)),
                       key=_natural)
        if not partial or not files:
            raise
        warning = f'{error}; reading {_names(files)}'
    missing = [path for path in files if not os.path.exists(path)]
    rest = [path for path in files if path not in missing]
    if missing and not (partial and rest):
        remedy = 'partial=True reads the others' if all('.mcap' in path.suffixes for path in rest
                                                        ) else 'the others can be given as files'
        raise BagError(f'{directory} cannot be read: files that its metadata.yaml lists are '
                       f'missing: {_names(missing)}{f"; {remedy}" * bool(rest)}')
    if missing:
        warning = f'{directory}: files that its metadata.yaml lists are missing: {_names(missing)}'
    return Recording(directory, rest, files[0] if files[0] in missing else None, warning)


def _listed(directory: Path) -> list[Path]:
    """Return the files that a metadata.yaml lists; raise a BagError if it cannot be read."""
    metadata = directory / 'metadata.yaml'
    refuse_special(metadata)
    from ruamel.yaml import YAML
    try:
        with metadata.open('rb') as file:
            text = checked_yaml(file.read(LONGEST_YAML + 1))
        information = YAML(typ='safe').load(text)['rosbag2_bagfile_information']
        compression = information.get('compression_format') or 'zstd'
        names = information['relative_file_paths']
        if not isinstance(names, list) or not names:
            raise ValueError('it lists no files')
        files = [directory / PurePath(name).name for name in names]
    except Exception as error:  # the YAML library raises errors of many types
        raise BagError(f'{directory} cannot be read: metadata.yaml: {error_line(error)} '
                       'partial=True reads the files without it') from None
    if compression != 'zstd':
        raise BagError(f'{directory} cannot be read: its compression format is '
                       f'{visible(repr(compression))}, not zstd')
    return files


def _part(path: Path, listed: dict[Path, list[Path]]) -> tuple[Path, int]:
    """Return the first part of the recording of a file, and the number of this part."""
    directory = path.parent
    if directory not in listed:
        listed[directory] = []
        with suppress(BagError, ImportError):  # the file can be read without metadata
            listed[directory] = _listed(directory)
    if path in listed[directory]:
        return listed[directory][0], listed[directory].index(path)
    match = _PART.fullmatch(path.name)
    if listed[directory] or match is None or _TIME.search(match[1]):
        return path, 0
    firsts = [path.with_name(f'{match[1]}_0{match[3]}{suffix}') for suffix in ('', '.zstd')]
    return next((first for first in firsts if os.path.exists(first)), firsts[0]), int(match[2])


def _names(files: Iterable[Path]) -> str:
    return comma_list([visible(file.name) for file in files], _SHOWN)
