"""Files that commands write: completely, or not at all."""

import errno
import os

from environment import on_unix
import pytest

from dummy_arm.cli.files import check_writable, whole_file
from dummy_arm.cli.parser import CommandError


def test_a_file_is_replaced_when_it_is_complete(tmp_path):
    """Until then, the old one stays; afterwards, there is no other file."""
    path = tmp_path / 'table.csv'
    path.write_text('old')
    with whole_file(path) as part:
        part.write_text('new')
        assert path.read_text() == 'old'
        assert part.parent == tmp_path  # on the same disk
    assert path.read_text() == 'new'
    assert [*tmp_path.iterdir()] == [path]


@pytest.mark.parametrize('error', [OSError(errno.ENOSPC, 'disk full'), KeyboardInterrupt()])
def test_a_file_stays_if_the_new_one_is_not_complete(tmp_path, error):
    """An error of the system names the file; others are passed on."""
    path = tmp_path / 'table.csv'
    path.write_text('old')

    def write():
        with whole_file(path) as part:
            part.write_text('a part')
            raise error

    with pytest.raises((CommandError, KeyboardInterrupt)) as caught:
        write()
    assert str(caught.value) == (f'cannot write {path}: disk full' if error.args else '')
    assert path.read_text() == 'old'
    assert [*tmp_path.iterdir()] == [path]


@on_unix
def test_a_link_stays_and_its_file_is_written(tmp_path):
    """A pipe or a device is not replaced."""
    (tmp_path / 'link').symlink_to('file')
    with whole_file(tmp_path / 'link') as part:
        part.write_text('new')
    assert (tmp_path / 'link').is_symlink()
    assert (tmp_path / 'file').read_text() == 'new'
    os.mkfifo(tmp_path / 'pipe')
    with (pytest.raises(CommandError, match=r'pipe: it is not a regular file$'),
          whole_file(tmp_path / 'pipe')):
        pytest.fail('the block must not run')


def test_a_path_that_cannot_be_written_is_refused(tmp_path):
    """A directory, or a file in a directory that is none."""
    check_writable(tmp_path / 'new')
    with pytest.raises(CommandError, match=r'it is a directory$'):
        check_writable(tmp_path)
    with pytest.raises(CommandError, match=r'missing is not a writable directory$'):
        check_writable(tmp_path / 'missing' / 'file')
