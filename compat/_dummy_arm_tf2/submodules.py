"""
Modules of a package that are imported on their first use; the packages need ROS.

If a package imported its modules while one thread imports the package and another one imports such
a module, each thread could wait for the other one: Python would raise a _DeadlockError.
"""

from importlib import import_module
import sys
from types import ModuleType
from typing import TYPE_CHECKING

import _dummy_arm_tf2.ros  # noqa: F401

if TYPE_CHECKING:  # so that type checkers find them, too
    import tf2_geometry_msgs.tf2_geometry_msgs  # noqa: F401
    import tf2_ros.buffer
    import tf2_ros.buffer_client
    import tf2_ros.buffer_interface
    import tf2_ros.static_transform_broadcaster
    import tf2_ros.transform_broadcaster
    import tf2_ros.transform_listener  # noqa: F401
    import tf2_sensor_msgs.tf2_sensor_msgs  # noqa: F401


def import_on_use(package: str, *modules: str) -> None:
    """Add a function `__getattr__` to a package, which imports its modules."""
    def import_module_of_package(name: str) -> ModuleType:
        if name in modules:
            return import_module(f'{package}.{name}')
        raise AttributeError(f'module {package!r} has no attribute {name!r}')

    vars(sys.modules[package])['__getattr__'] = import_module_of_package
