"""A pytest plugin for an emulated desktop: it hides the packages of `compat` from the tests."""

from pathlib import Path
import sys

sys.path[:] = [directory for directory in sys.path if Path(directory).name != 'compat']
