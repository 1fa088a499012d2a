"""The messages of a database of rosbag2."""

from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
import sqlite3

from puretf._bag.contents import Contents
from puretf._bag.unpacking import Item, TICK


def records_of_database(path: Path, contents: Contents) -> Iterator[Item]:
    """Yield the messages that are read, in the order of time."""
    log = path.with_name(f'{path.name}-wal')  # the newest messages, if the recorder was killed
    mode = 'mode=ro' if log.exists() and log.stat().st_size else 'immutable=1'
    with closing(sqlite3.connect(f'{path.absolute().as_uri()}?{mode}', uri=True)) as database:
        definitions: dict[str, str] = {}
        with suppress(sqlite3.Error):  # old databases have none
            definitions = dict(database.execute(
                'SELECT topic_type, encoded_message_definition FROM message_definitions'))
        rows = database.execute('SELECT * FROM topics')
        topics = {}
        for row in rows:
            about = dict(zip([name for name, *_ in rows.description], row))
            topics[about['id']] = contents.topic(
                about['name'], about['type'], definitions.get(about['type']) or '',
                about['serialization_format'], about.get('offered_qos_profiles') or '')
        ((first, last),) = database.execute('SELECT (SELECT min(timestamp) FROM messages), '
                                            '(SELECT max(timestamp) FROM messages)')
        contents.add_span(first or 0, last or 0)
        wanted = ', '.join(str(key) for key, topic in topics.items() if topic.is_read)
        for number, (key, time, data) in enumerate(database.execute(
                f'SELECT topic_id, timestamp, CASE WHEN topic_id IN ({wanted}) THEN data END '
                'FROM messages ORDER BY timestamp, id')):
            if number % TICK == 0:
                yield float((time - first) / (last - first or 1))
            topic = topics[key]
            topic.count += 1
            if topic.is_read:
                yield topic, time, data if isinstance(data, bytes) else b''
