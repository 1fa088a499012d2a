"""Files that commands write: completely, or not at all."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
import os
from pathlib import Path
from secrets import token_hex
from stat import S_IMODE, S_ISDIR, S_ISREG
from typing import Optional

from puretf_tools.cli.parser import CommandError, UsageError


def path_to_write(output: str, endings: Sequence[str]) -> Path:
    """Return the path of a file that can be written; its ending must be one of some."""
    path = Path(output)
    if path.suffix.lower() not in endings or output.endswith('/'):
        raise UsageError(f'{output!r} must end in {", ".join(endings)}')
    _mode(path)
    if not os.access(path.parent, os.W_OK):
        raise CommandError(f'cannot write {path}: {path.parent} is not a writable directory')
    return path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """
    Let the `with` block write a temporary file, which then replaces the file and gets its mode.

    If the block raises an exception, the file is unchanged. A link stays: its target is replaced.
    """
    mode = _mode(path)
    try:
        target = Path(os.path.realpath(path))
        part = target.with_name(f'.{target.name}.{token_hex(8)}')
        part.touch(0o666 if mode is None else 0o600, exist_ok=False)
        try:
            yield part
            if mode is not None:
                part.chmod(S_IMODE(mode))
            part.replace(target)
        finally:
            with suppress(OSError):
                part.unlink()
    except OSError as error:
        raise CommandError(f'cannot write {path}: {error.strerror or error}') from None


def _mode(path: Path) -> Optional[int]:
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return None
    except OSError as error:
        raise CommandError(f'cannot write {path}: {error.strerror or error}') from None
    if not S_ISREG(mode):
        kind = 'a directory' if S_ISDIR(mode) else 'not a regular file'
        raise CommandError(f'cannot write {path}: it is {kind}')
    return mode
