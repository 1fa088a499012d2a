"""
Fuzz the package by atheris: `fuzz.py TARGET FOLDER [ARGUMENT OF LIBFUZZER...]`.

It starts from the seeds of the target, and from the inputs in data/fuzz/TARGET; what it makes up
is kept in FOLDER. An input that finds a fault is written to data/fuzz/TARGET, where test_fuzz.py
uses it; `fuzz.py TARGET FILE` repeats what it does. Without arguments, print the targets.
"""

from collections.abc import Callable, Iterator
from importlib import import_module
import os
from pathlib import Path
import sys
from typing import NamedTuple

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')  # before rclpy starts

DATA = Path(__file__).parent.parent / 'data' / 'fuzz'
#: The module of each target.
MODULES = {
    'cdr': 'fuzz_messages', 'ros1': 'fuzz_messages', 'bags': 'fuzz_messages',
    'description': 'fuzz_messages',
    'names': 'fuzz_surfaces', 'websocket': 'fuzz_surfaces', 'views': 'fuzz_surfaces',
    'meshes': 'fuzz_shapes', 'clouds': 'fuzz_shapes'}
#: One input may take 20 s, of some targets 5 s, and the process may use 2 GB.
_LIMITS = '-timeout=20', '-rss_limit_mb=2048', '-max_len=4096', '-print_final_stats=1'
_FAST = 'views', 'meshes', 'clouds'


class Target(NamedTuple):
    """What is fuzzed."""

    check: Callable[[bytes], None]  #: raises an exception if it finds a fault
    seeds: Callable[[], Iterator[bytes]]


def target(name: str) -> Target:
    """Import a target."""
    module = import_module(MODULES[name])
    return Target(getattr(module, f'check_{name}'), getattr(module, f'seeds_of_{name}'))


def reproducers(name: str) -> list[Path]:
    """Return the files of the inputs that have found a fault of a target before."""
    return sorted((DATA / name).glob('*'))


def main(name: str, where: str, *arguments: str) -> None:
    """Run a target by libFuzzer, which ends this process."""
    atheris = import_module('atheris')
    with atheris.instrument_imports(include=['puretf', 'puretf_tools', 'dummy_arm',
                                             *MODULES.values()]):
        check, seeds = target(name)
        check(b'')  # finish the late imports, which are instrumented, too
    folders = [where]
    if not Path(where).is_file():
        for folder in Path(where), DATA / name:
            folder.mkdir(parents=True, exist_ok=True)
        for number, data in enumerate(seeds()):
            Path(where, f'seed_{number}').write_bytes(data)
        folders += [str(DATA / name), f'-artifact_prefix={DATA / name}/']
    atheris.Setup([name, *_LIMITS, *['-timeout=5'] * (name in _FAST), *folders, *arguments], check)
    atheris.Fuzz()


if __name__ == '__main__':
    if len(sys.argv) == 1:
        print(*MODULES, sep='\n')
    else:
        main(*sys.argv[1:])
