"""
Stand-ins for the pytest plugins of launch, which a desktop has.

launch_stand_in-1.dist-info gives them the names of the real ones, so that pytest loads them, or
leaves them out, as it does the real ones. They do what has kept our tests from running.
"""

import logging
from pathlib import Path

from _pytest.pathlib import import_path
import pytest

_OPTIONS = {'consider_namespace_packages': False} if pytest.version_tuple >= (8, 2) else {}


class _Hooks:
    @pytest.hookspec(firstresult=True)
    def pytest_launch_collect_makemodule(self, module_path, parent, entrypoint):
        """Make a test of launch."""


class LaunchTesting:
    """It imports each test file, in the mode `prepend`, and catches only SyntaxErrors."""

    def pytest_addhooks(self, pluginmanager):
        """Declare the hook that LaunchRos implements."""
        pluginmanager.add_hookspecs(_Hooks)

    def pytest_configure(self):
        """Replace the class of loggers, as launch.logging does when it is imported."""
        logging.setLoggerClass(LaunchLogger)

    def pytest_pycollect_makemodule(self, module_path: Path, parent: pytest.Collector) -> None:
        """Look for a test of launch in a test file, as launch_testing 3.4 does."""
        try:
            module = import_path(module_path, root=None, **_OPTIONS)  # type: ignore[arg-type]
        except SyntaxError:
            return
        assert not hasattr(module, 'generate_test_description'), 'this is a test of launch'


class LaunchRos:
    """It is an error without launch_testing."""

    def pytest_launch_collect_makemodule(self, module_path, parent, entrypoint):
        """Make no test."""


class LaunchLogger(logging.getLoggerClass()):  # type: ignore[misc]
    """A logger with a handler of its own, which does not propagate its records."""

    def __init__(self, *args, **kwargs):
        """Create a logger."""
        super().__init__(*args, **kwargs)
        self.propagate = False
        self.addHandler(logging.StreamHandler())


launch_testing, launch_ros, launch_pytest = LaunchTesting(), LaunchRos(), object()
