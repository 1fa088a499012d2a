"""Messages of TF and headers as `tf_doctor` gets them, made by hand."""

import struct

from puretf._core.pose import Row
from puretf._wire import cdr
from puretf._wire.encoding import CDR
from puretf.bag import Headers
from puretf_tools.doctor.observation import Observation
from puretf_tools.doctor.tf_statistics import Statistics

S, MS = 10**9, 10**6
T = 1_700_000_000 * S
_STILL = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0


class Recorded:
    """A message of TF."""

    publisher, encoding = '/robot', CDR

    def __init__(self, time, is_static, *rows):
        """Serialise transforms; `time`: the arrival (ns)."""
        self.time, self.is_static, self.data = time, is_static, cdr.pack(rows)

    def rows(self):
        """Return the transforms."""
        return CDR.unpack(self.data)


def tf(arrival, stamp, *edges, is_static=False, x=0.0):
    """Return a message of TF; times in ms after `T`, each edge 'parent child'."""
    return Recorded(T + arrival * MS, is_static, *(
        Row(T + stamp * MS, parent, child, (x, *_STILL[1:]))
        for parent, child in (edge.split(' ') for edge in edges)))


def header_of(stamp, frame):
    """Serialise a message with a header, in CDR."""
    name = frame.encode() + b'\0'
    return struct.pack('<4siII', b'\0\1\0\0', *divmod(stamp, S), len(name)) + name


def judged(transforms, messages, frame='base', **kwargs):
    """Return the `MessageTimes` of messages; the arguments are those of `observed`."""
    (times,) = observed(transforms, messages, frame, **kwargs).message_times
    return times


def observed(transforms, messages, frame='base', most=20_000, **kwargs):
    """
    Return the `Observation` of transforms, and of messages on /scan.

    :param messages: each (arrival, stamp) in ms after `T`; None: the stamp 0.
    :param most: the size of the sample of messages.
    """
    statistics, headers = Statistics(), Headers(most=most)
    statistics.add_messages(sorted(transforms, key=lambda message: message.time))
    for arrival, stamp in messages:
        if headers.wants_next():
            headers.add(
                T + arrival * MS, header_of(0 if stamp is None else T + stamp * MS, frame))
    return Observation(statistics, 'here', headers={'/scan': headers}, **kwargs)
