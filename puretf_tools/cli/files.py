"""Files that commands write: completely, or not at all."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
from secrets import token_hex
import shutil

from puretf_tools.cli.parser import CommandError, UsageError


def path_to_write(output: str, endings: Sequence[str]) -> Path:
    """Return the path of a file that can be written; its ending must be one of some."""
    path = Path(output)
    if path.suffix.lower() not in endings or output.endswith('/'):
        raise UsageError(f'{output!r} must end in {", ".join(endings)}')
    _check_file(path)
    if not os.access(path.parent, os.W_OK):
        raise CommandError(f'cannot write {path}: {path.parent} is not a writable directory')
    return path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """
    Let the `with` block write a temporary file, which then replaces the file and gets its mode.

    If the block raises an exception, the file is unchanged. A link stays: its target is replaced.
    """
    _check_file(path)
    try:
        target = Path(os.path.realpath(path))
        part = target.with_name(f'.{target.name}.{token_hex(8)}')
        part.touch(0o600 if target.exists() else 0o666, exist_ok=False)
        try:
            yield part
            if target.exists():
                shutil.copymode(target, part)
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise CommandError(f'cannot write {path}: {error.strerror or error}') from None


def _check_file(path: Path) -> None:
    if os.path.exists(path) and not os.path.isfile(path):  # Path.exists may raise an OSError
        raise CommandError(f'cannot write {path}: it is not a regular file')
