"""The TF messages of a database of rosbag2; rosbags 0.11 refuses some, without definitions."""

from collections import defaultdict
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
import shlex
import sqlite3
from typing import Any

from puretf._bag.context import ADVANCE, BagContext, Record, Topic
from puretf._bag.formats import BagError, refuse_special
from puretf._bag.rosbags_private import durabilities

#: Views, virtual tables and generated columns, which a few bytes can make endless.
_NO_TABLES = """SELECT name FROM sqlite_master WHERE lower(name) IN
    ('topics', 'messages', 'message_definitions') AND (sql NOT LIKE 'CREATE TABLE %' OR EXISTS
    (SELECT * FROM pragma_table_xinfo(sqlite_master.name) WHERE hidden))"""


def records_of_database(path: Path, context: BagContext) -> Iterator[Record]:
    _check_log(path)
    with closing(sqlite3.connect(f'{path.absolute().as_uri()}?immutable=1', uri=True)) as database:
        database.text_factory = lambda data: data.decode(errors='replace')
        database.set_progress_handler(context.tick, 100_000)
        for name, in database.execute(_NO_TABLES):
            raise ValueError(f'{name} is not a table of plain columns')
        topics = _topics(database, context)
        read = {key: topic for key, topic in topics.items() if topic.is_read}
        ((first, last),) = database.execute('SELECT (SELECT min(timestamp) FROM messages), '
                                            '(SELECT max(timestamp) FROM messages)')
        query = ('SELECT topic_id, timestamp, CASE WHEN topic_id IN '
                 f'({", ".join(map(str, read))}) THEN data END FROM messages')
        in_order = f'{query} ORDER BY timestamp, id'
        # Without an index, SQLite would write all data to temporary files to sort them.
        plan = str([*database.execute(f'EXPLAIN QUERY PLAN {in_order}')])
        rows = database.execute(query if 'TEMP B-TREE' in plan else in_order)
        span = 0
        if type(first) is type(last) is int:  # SQLite does not enforce the types
            span = last - first
            context.add_span(first, last)
        counts: defaultdict[Any, int] = defaultdict(int)
        number, before, since = -1, None, 0  # counted when the topic changes, which is faster
        for number, (key, time, data) in enumerate(rows):
            time = time if type(time) is int else 0
            if number % ADVANCE == 0:
                context.advance((time - first) / span if span else 0.0)
            if key != before:
                counts[before], before, since = counts[before] + number - since, key, number
            if key in read and (record := context.record(
                    read[key], time, data if isinstance(data, bytes) else b'')):
                yield record
        counts[before] += number + 1 - since
        for key, topic in topics.items():
            topic.count += counts[key]


def _check_log(path: Path) -> None:
    log = path.with_name(f'{path.name}-wal')
    refuse_special(log)
    if log.exists() and log.stat().st_size > 0:
        program = ("import sqlite3; sqlite3.connect("
                   f"{str(path.absolute())!r}).execute('PRAGMA wal_checkpoint(TRUNCATE)')")
        raise BagError(f'{path} was not closed after recording, and {log.name} has data that are '
                       'not in the database yet. SQLite inserts them: python3 -c '
                       f'{shlex.quote(program)}')


def _topics(database: sqlite3.Connection, context: BagContext) -> dict[int, Topic]:
    definitions: dict[Any, Any] = {}
    with suppress(sqlite3.Error):  # old databases have none
        definitions = dict(database.execute(
            'SELECT topic_type, encoded_message_definition FROM message_definitions'))
    names = {row[1] for row in database.execute('PRAGMA table_info(topics)')}
    qos = 'offered_qos_profiles' if 'offered_qos_profiles' in names else "''"
    return {key: context.add_topic(
        str(name), str(msgtype), str(definitions.get(msgtype) or ''), str(encoding),
        durabilities(str(profiles)))
        for key, name, msgtype, encoding, profiles in database.execute(
            f'SELECT id, name, type, serialization_format, {qos} FROM topics')}
