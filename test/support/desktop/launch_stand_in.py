"""
A pytest plugin for an emulated desktop: `-p launch_stand_in`.

It hides the packages of `compat`, which are not installed on a desktop, from the tests. And it
changes logging as the plugins of launch do.

They import launch.logging, which replaces the class of loggers by one whose loggers have handlers
of their own and do not propagate.
"""

import logging
from pathlib import Path
import sys

sys.path[:] = [directory for directory in sys.path if Path(directory).name != 'compat']


class LaunchLogger(logging.getLoggerClass()):  # type: ignore[misc]
    """A logger with a handler of its own, which does not propagate its records."""

    def __init__(self, *args, **kwargs):
        """Create a logger."""
        super().__init__(*args, **kwargs)
        self.propagate = False
        self.addHandler(logging.StreamHandler())


logging.setLoggerClass(LaunchLogger)
