"""The messages of a database of rosbag2."""

from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
import sqlite3

from puretf._bag.contents import Contents, Topic
from puretf._bag.unpacking import Item, TICK
from puretf._text.names import abbreviated


def records_of_database(path: Path, contents: Contents) -> Iterator[Item]:
    """Yield the messages that are read, in the order of time."""
    log = path.with_name(f'{path.name}-wal')  # the newest messages, if the recorder was killed
    has_log = log.exists() and log.stat().st_size > 0
    mode = 'mode=ro' if has_log else 'immutable=1'
    try:
        with closing(sqlite3.connect(f'{path.absolute().as_uri()}?{mode}', uri=True)) as database:
            database.text_factory = lambda text: text.decode(errors='replace')
            yield from _messages(database, _topics(database, contents), contents)
    except (sqlite3.Error, UnicodeError) as error:  # of texts in the schema, too
        why = (f'it is no database of rosbag2 ({error})' if str(error).startswith('no such ') else
               f'SQLite reports: {error}')
        raise ValueError(why + has_log * (
            f'. To read it with {log.name}, end the program that writes them, or copy both into a '
            'directory in which you can write')) from None


def _topics(database: sqlite3.Connection, contents: Contents) -> dict[int, Topic]:
    definitions: dict[str, str] = {}
    with suppress(sqlite3.Error):  # old databases have none
        definitions = dict(database.execute(
            'SELECT topic_type, encoded_message_definition FROM message_definitions'))
    rows = database.execute('SELECT id, name, type, serialization_format, * FROM topics')
    topics = {}
    for row in rows:
        about = dict(zip([name for name, *_ in rows.description], row))
        key, texts = row[0], (*row[1:4], about.get('offered_qos_profiles') or '')
        if type(key) is not int or not all(isinstance(text, str) for text in texts):
            raise ValueError(f'its table topics has the row {abbreviated(repr((key, *texts)))}, '
                             'which is not a number and texts')
        name, msgtype, encoding, qos = texts
        topics[key] = contents.topic(name, msgtype, definitions.get(msgtype) or '', encoding, qos)
    return topics


def _messages(database: sqlite3.Connection, topics: dict[int, Topic], contents: Contents
              ) -> Iterator[Item]:
    ((first, last),) = database.execute('SELECT (SELECT min(timestamp) FROM messages), '
                                        '(SELECT max(timestamp) FROM messages)')
    if last is not None:
        if not (type(first) is type(last) is int and first >= 0):
            raise _wrong_row(f'times from {first!r} to {last!r}')
        contents.add_span(first, last)
    wanted = ', '.join(str(key) for key, topic in topics.items() if topic.is_read)
    for number, (key, time, data) in enumerate(database.execute(
            f'SELECT topic_id, timestamp, CASE WHEN topic_id IN ({wanted}) THEN data END '
            'FROM messages ORDER BY timestamp, id')):
        if (topic := topics.get(key)) is None or type(time) is not int:
            raise _wrong_row(f'the topic {key!r} and the time {time!r}')
        if number % TICK == 0:
            yield (time - first) / (last - first or 1)
        topic.count += 1
        if topic.is_read:
            yield topic, time, data if isinstance(data, bytes) else b''


def _wrong_row(values: str) -> ValueError:
    return ValueError(f'its table messages has {abbreviated(values)}, not a topic of its table '
                      'topics and nanoseconds from 0 on')
