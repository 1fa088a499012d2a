"""The commands' entry points; light, so that Ctrl-C is a normal end while they still import."""

from importlib import import_module

from dummy_arm.interruption import has_come, ignore_signals, note_signals


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
    note_signals()  # raised while modules import, KeyboardInterrupt becomes other errors
    try:
        main = import_module(module).main
        return 0 if has_come() else int(main())
    except KeyboardInterrupt:
        return 0
    finally:
        ignore_signals()
