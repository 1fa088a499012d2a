"""
A pytest plugin that changes logging as launch's plugins do: `-p launch_stand_in`.

They import launch.logging, which replaces the class of loggers by one whose loggers have handlers
of their own and do not propagate.
"""

import logging


class LaunchLogger(logging.getLoggerClass()):  # type: ignore[misc]
    """A logger with a handler of its own, which does not propagate its records."""

    def __init__(self, *args, **kwargs):
        """Create a logger."""
        super().__init__(*args, **kwargs)
        self.propagate = False
        self.addHandler(logging.StreamHandler())


logging.setLoggerClass(LaunchLogger)
