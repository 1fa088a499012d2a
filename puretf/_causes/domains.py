"""The ROS domains in which processes of this machine take part, as /proc of Linux shows them."""

from collections.abc import Collection
from contextlib import suppress
import os
from pathlib import Path
import sys

from puretf._text.names import comma_list, shortened

#: The ports of a ROS domain begin at `FIRST_PORT + PORTS * domain` (RTPS specification, 9.6.2).
FIRST_PORT, PORTS = 7400, 250


def command_of(pid: int) -> list[str]:
    """Return the command line of a process; empty if it has ended."""
    try:
        line = Path(f'/proc/{pid}/cmdline').read_bytes()
    except OSError:
        return []
    return [os.fsdecode(argument) for argument in line.split(b'\0')[:-1]]


def short_command(pid: int) -> str:
    """Return the command line of a process for a text; '' if it has ended."""
    return shortened(' '.join(command_of(pid)))


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
    return {(port - FIRST_PORT) // PORTS for port in udp_ports() if port >= FIRST_PORT}


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
            domain, offset = divmod(port - FIRST_PORT, PORTS)
            if domain >= 0 and offset >= 10 and offset % 2 == 0 and port + 1 in ports:
                found[domain] = pid
    return found


def other_user(domain: int) -> str:
    """Return another user whose processes are in a domain, with the shared memory of Fast DDS."""
    if sys.platform != 'win32':
        from pwd import getpwuid
        for path in Path('/dev/shm').glob('fastrtps_port[0-9]*'):
            number = path.name.removeprefix('fastrtps_port')
            with suppress(OSError, KeyError):  # it has just been removed; a user without a name
                if number.isdigit() and (int(number) - FIRST_PORT) // PORTS == domain and (
                        user := path.stat().st_uid) != os.geteuid():
                    return getpwuid(user).pw_name
    return ''


def other_domains(own: int) -> str:
    """Return a sentence on the other domains that have processes; '' if there are none."""
    if not used_domains() - {own}:
        return ''
    domains = ros_domains([int(path.name) for path in Path('/proc').glob('[0-9]*')])
    domains.pop(own, None)
    others = [f'{domain} (PID {pid}: {short_command(pid)})'
              for domain, pid in sorted(domains.items())]
    return (f' On this machine, programs run in other ROS domains: '
            f'{comma_list(others)}.' if others else '')
