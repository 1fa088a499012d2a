"""The ROS domains in which processes of this machine take part, as /proc of Linux shows them."""

from collections.abc import Collection
from contextlib import suppress
import os
from pathlib import Path

from puretf._text.names import comma_list, shortened

#: The ports of a ROS domain begin at `FIRST_PORT + PORTS * domain` (RTPS specification, 9.6.2).
FIRST_PORT, PORTS = 7400, 250
#: The settings with which ROS does not look for other machines.
_HIDE_OTHERS = ('ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST', 'ROS_AUTOMATIC_DISCOVERY_RANGE=OFF',
                'ROS_LOCALHOST_ONLY=1')


def domain_of(port: int) -> int:
    return (port - FIRST_PORT) // PORTS


def udp_ports() -> dict[int, str]:
    """Return the UDP ports that are in use, each with the number of its socket."""
    found = {}
    for path in '/proc/net/udp', '/proc/net/udp6':
        with suppress(OSError):
            for line in Path(path).read_text().splitlines()[1:]:
                fields = line.split()
                found[int(fields[1].rpartition(':')[2], 16)] = fields[9]
    return found


def used_domains() -> set[int]:
    """Return the ROS domains of which a port is in use; those above 100 share theirs."""
    return {domain_of(port) for port in udp_ports() if port >= FIRST_PORT}


def ros_domains(pids: Collection[int]) -> dict[int, int]:
    """Return the ROS domains in which processes take part, each with one of the process ids."""
    # A participant binds the ports 10 + 2 i and 11 + 2 i of its domain for data that is sent to it
    # alone. Other sockets may have single ports of this range.
    sockets = {f'socket:[{inode}]': port for port, inode in udp_ports().items()}
    found = {}
    for pid in pids:
        ports = set()
        with suppress(OSError):
            for path in Path(f'/proc/{pid}/fd').iterdir():
                with suppress(OSError):
                    ports.add(sockets.get(os.readlink(path), 0))
        for port in ports:
            offset = (port - FIRST_PORT) % PORTS
            if port >= FIRST_PORT and offset >= 10 and offset % 2 == 0 and port + 1 in ports:
                found[domain_of(port)] = pid
    return found


def other_user(domain: int) -> str:
    """Return another user whose processes are in a domain, with the shared memory of Fast DDS."""
    for path in Path('/dev/shm').glob('fast*_port[0-9]*'):
        # The file has just been removed, is another one, or the user has no name.
        with suppress(OSError, ValueError, KeyError):
            port = int(path.name.partition('_port')[2])
            if domain_of(port) == domain and path.stat().st_uid != os.geteuid():
                return path.owner()
    return ''


def described(own: int) -> str:
    """Name a ROS domain, the other ones on this machine, and what hides other machines."""
    domains = ros_domains([int(path.name) for path in Path('/proc').glob('[0-9]*')]
                          if used_domains() - {own} else ())
    texts = [f'ROS domain {own}']
    if others := [f'{domain} (PID {pid}: {_command(pid)})'
                  for domain, pid in sorted(domains.items()) if domain != own]:
        texts.append(f'On this machine, programs run in other ROS domains: {comma_list(others)}')
    texts += [f'{setting} hides other machines' for setting in map('='.join, os.environ.items())
              if setting.upper() in _HIDE_OTHERS]
    return '. '.join(texts)


def _command(pid: int) -> str:
    with suppress(OSError):
        line = Path(f'/proc/{pid}/cmdline').read_bytes()
        command = os.fsdecode(line).replace('\0', ' ').strip()
        return shortened(command.partition('\n')[0])  # `python -c` with a program of some lines
    return ''
