"""
The TF messages of a database of rosbag2 (sqlite3).

rosbags 0.11 refuses a database with a type whose definition rosbag2 did not find.
"""

from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
import shlex
import sqlite3
from typing import Any

from dummy_arm.tf._bag.context import BagContext, BagTopic, durabilities, HEADERS, Record, Stream
from dummy_arm.tf._bag.formats import BagError, refuse_special
from dummy_arm.tf._bag.unpacking import unpack_message

#: Progress is reported once for this many messages.
_ADVANCE = 100


def records_of_database(path: Path, context: BagContext) -> Iterator[Record]:
    _check_log(path)
    with closing(sqlite3.connect(f'{path.absolute().as_uri()}?immutable=1', uri=True)) as database:
        database.text_factory = lambda data: data.decode(errors='replace')
        streams = _streams(database, context)
        wanted = [key for key, stream in streams.items() if isinstance(stream, Stream)]
        ((first, last),) = database.execute('SELECT (SELECT min(timestamp) FROM messages), '
                                            '(SELECT max(timestamp) FROM messages)')
        rows = database.execute('SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN '
                                f'({_list(wanted)}) ORDER BY timestamp, id')
        span = last - first if type(first) is type(last) is int else 0
        for number, (key, time, data) in enumerate(rows):
            time = time if type(time) is int else 0  # SQLite does not enforce the types
            if number % _ADVANCE == 0:
                context.advance((time - first) / span if span else 0.0)
            yield streams[key], time, _message(data, context)
        _read_headers(database, {key: stream for key, stream in streams.items()
                                 if isinstance(stream, BagTopic)}, context)


def _check_log(path: Path) -> None:
    log = path.with_name(f'{path.name}-wal')
    refuse_special(log)
    if log.exists() and log.stat().st_size > 0:
        program = ("import sqlite3; sqlite3.connect("
                   f"{str(path.absolute())!r}).execute('PRAGMA wal_checkpoint(TRUNCATE)')")
        raise BagError(f'{path} was not closed after recording, and {log.name} has data that are '
                       'not in the database yet. SQLite inserts them: python3 -c '
                       f'{shlex.quote(program)}')


def _streams(database: sqlite3.Connection, context: BagContext) -> dict[int, Any]:
    definitions: dict[Any, Any] = {}
    with suppress(sqlite3.Error):  # old databases have none
        definitions = dict(database.execute(
            'SELECT topic_type, encoded_message_definition FROM message_definitions'))
    names = {row[1] for row in database.execute('PRAGMA table_info(topics)')}
    qos = 'offered_qos_profiles' if 'offered_qos_profiles' in names else "''"
    return {key: context.add_topic(
        str(name), str(msgtype), str(encoding), str(definitions.get(msgtype) or ''),
        durabilities(str(profiles)))
        for key, name, msgtype, encoding, profiles in database.execute(
            f'SELECT id, name, type, serialization_format, {qos} FROM topics')}


def _read_headers(database: sqlite3.Connection, topics: dict[int, BagTopic], context: BagContext
                  ) -> None:
    """Read the headers of the first messages of topics; find these messages first."""
    for key, data in database.execute(
            'SELECT topic_id, data FROM messages WHERE id IN (SELECT id FROM (SELECT id, '
            'row_number() OVER (PARTITION BY topic_id ORDER BY timestamp, id) AS number FROM '
            f'messages WHERE topic_id IN ({_list(topics)})) WHERE number <= {HEADERS}) '
            'ORDER BY timestamp, id'):
        context.advance(1.0)
        if topics[key].needs_headers():
            topics[key].add_header(_message(data, context))


def _list(keys: Any) -> str:
    return ', '.join(str(int(key)) for key in keys)


def _message(data: Any, context: BagContext) -> bytes:
    return unpack_message(data, context.max_bytes) if isinstance(data, bytes) else b''
