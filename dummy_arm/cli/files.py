"""Files that commands write: completely, or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import os
from pathlib import Path

from dummy_arm.cli.parser import CommandError


def check_writable(path: Path) -> None:
    """
    Check that a file can be written, so that an error is reported before the work begins.

    :param path: path of the file.
    :raises CommandError: if the path is a directory, or if the directory of the file is not
        writable.
    """
    if path.is_dir():
        raise CommandError(f'cannot write {path}: it is a directory')
    if not os.access(path.parent, os.W_OK):
        raise CommandError(f'cannot write {path}: {path.parent} is not a writable directory')


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """
    Write a file completely, or leave it unchanged.

    :param path: path of the file; a symbolic link stays, and the file that it names is written.
    :returns: a context manager; the target of `as` is the path of a temporary file in the same
        directory, which the block writes. At the end of the block, the temporary file replaces the
        file; if the block raises an exception, it is deleted.
    :raises CommandError: if the file cannot be written, if it is a device or a pipe, or if the
        block raises an OSError.
    """
    if path.exists() and not path.is_file():  # it must not be replaced
        raise CommandError(f'cannot write {path}: it is not a regular file')
    target = path.resolve()
    part = target.with_name(f'.{target.name}.{os.getpid()}')
    try:
        yield part
        part.replace(target)
    except OSError as error:
        raise CommandError(f'cannot write {path}: {error.strerror or error}') from None
    finally:
        with suppress(OSError):
            part.unlink()
