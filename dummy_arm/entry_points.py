"""The commands' entry points; light, so that Ctrl-C is a normal end while they still import."""

from importlib import import_module
import signal


def dummy_arm() -> int:
    """Run `dummy_arm.dummy_arm`."""
    return _run('dummy_arm.dummy_arm')


def _run(module: str) -> int:
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return int(import_module(module).main())
    except KeyboardInterrupt:
        return 0
