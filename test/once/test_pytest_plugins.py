"""The settings of pytest beside the plugins of launch, or beside stand-ins for them."""

import os
import subprocess
import sys

from environment import DESKTOP, ROOT
import pytest

TEST = 'def test_it():\n    pass\n'


@pytest.fixture
def run(tmp_path):
    """Run pytest on two files of one name, and a file that is skipped at its top."""
    for path, text in (('a/test_same.py', TEST), ('b/test_same.py', TEST),
                       ('b/test_skipped.py', f'import pytest\npytest.skip("", '
                                             f'allow_module_level=True)\n{TEST}')):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(text)
    environment = {name: value for name, value in os.environ.items()
                   if not name.startswith('PYTEST_')} | DESKTOP

    def call(*arguments):
        return subprocess.run(
            [sys.executable, '-m', 'pytest', '-p', 'no:cacheprovider', '-c',
             ROOT / 'pyproject.toml', *arguments], cwd=tmp_path, env=environment, text=True,
            stdout=subprocess.PIPE).stdout

    return lambda *arguments: call(*arguments, 'a', 'b')


def test_with_the_settings_all_tests_run(run):
    assert '2 passed, 1 skipped' in run()


def test_without_the_settings_no_test_runs(run):
    output = run('-o', 'addopts=--import-mode=importlib')
    assert 'ImportPathMismatchError' in output
    assert 'passed' not in output


def test_without_the_settings_a_skip_at_the_top_of_a_file_hides_its_folder(run):
    output = run('-o', 'addopts=--import-mode=importlib', '--ignore', 'a/test_same.py')
    assert '1 skipped in' in output
    assert 'passed' not in output
