"""The commands' entry points; light, so that Ctrl-C is a normal end while they still import."""

from importlib import import_module
import signal


def dummy_arm() -> int:
    """Run `dummy_arm.dummy_arm`."""
    return _run('dummy_arm.dummy_arm')


def dynamic_tf_publisher() -> int:
    """Run `dummy_arm.tools.dynamic_tf_publisher`."""
    return _run('dummy_arm.tools.dynamic_tf_publisher')


def param() -> int:
    """Run `dummy_arm.tools.param`."""
    return _run('dummy_arm.tools.param')


def static_transform_publisher() -> int:
    """Run `dummy_arm.tools.static_transform_publisher`."""
    return _run('dummy_arm.tools.static_transform_publisher')


def view_frames() -> int:
    """Run `dummy_arm.tools.view_frames`."""
    return _run('dummy_arm.tools.view_frames')


def _run(module: str) -> int:
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return int(import_module(module).main())
    except KeyboardInterrupt:
        return 0
    finally:  # it ends as it is; a signal would only make it look bad
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
