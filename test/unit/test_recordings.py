"""Several paths: split recordings, directories, patterns, and recordings without metadata."""

from collections import Counter
from pathlib import Path
import re
import shutil
import struct
from tempfile import TemporaryDirectory

from environment import DATA
import pytest

from puretf import bag, LookupException
from puretf.bag import BagError, read, recordings

bags = pytest.importorskip('bags')
from ruamel.yaml import YAML  # noqa: E402

S = bags.S
#: `rosbag record --split --duration=2s` of ROS 1.15 wrote these: the static transform from
#: base_link to laser was sent once, before the recording began.
SPLIT = Path(__file__).parents[1] / 'data' / 'split'


def parts(path, kind='mcap', numbers=(0, 1, 2)):
    """Write the parts of a split recording: map -> odom is static and in the first part only."""
    path.mkdir(exist_ok=True)
    files = []
    for number in numbers:
        content = [*bags.walk(3, begin=(100 + 4 * number) * S)][int(number > 0):]
        with TemporaryDirectory() as directory:
            file = bags.file_of(bags.make(Path(directory) / 'part', kind, content))
            suffix = file.name.partition('.')[2]
            files.append(Path(shutil.move(file, path / f'robot_{number}.{suffix}')))
    return files


def with_metadata(path, files):
    """Move the files of a recording into a directory with a metadata.yaml that lists them."""
    whole = bags.make(path, 'mcap', bags.walk(1))
    metadata = whole / 'metadata.yaml'
    listed = ''.join(f'\n  - {file.name}' for file in files)
    metadata.write_text(metadata.read_text().replace(f'\n  - {whole.name}.mcap', listed))
    bags.file_of(whole).unlink()
    return whole, [file.rename(whole / file.name) for file in files]


def counts(path, **kwargs):
    """Return the number of samples of each frame."""
    return {frame.name: frame.length for frame in read(path, **kwargs).frames()}


WHOLE = {'odom': 1, 'base_link': 93}


@pytest.mark.parametrize('given', [
    lambda: [SPLIT / f'robot_{i}.bag' for i in (2, 0, 1)], lambda: SPLIT,
    lambda: str(SPLIT / 'robot_*.bag'), lambda: [str(SPLIT / 'robot_[0-2].bag')]],
    ids=['files', 'directory', 'pattern', 'patterns'])
def test_a_recording_that_rosbag_has_split(given):
    """Whatever names its files, they are one bag; only the first part has static transforms."""
    assert counts(given()) == {'base_link': 57, 'laser': 1}
    times = [message.time for message in bags.messages(given())]
    assert times == sorted(times)
    assert len(times) == 58


def missing_part(path, **kwargs):
    """Return which part of a recording is missing."""
    with bag.open(path, **kwargs) as opened:
        return opened.missing_part


def test_a_later_part_that_rosbag_has_split():
    """What needs a static transform names the first part, in place of a remedy in the robot."""
    buffer = read([SPLIT / 'robot_1.bag', SPLIT / 'robot_2.bag'])
    assert [frame.name for frame in buffer.frames()] == ['base_link']
    with pytest.raises(LookupException) as error:
        buffer.lookup_transform('map', 'laser')
    assert str(error.value).endswith(
        f"Known frames: 'base_link', 'map'. {SPLIT}/robot_1.bag is without the first part of "
        f'its recording, which usually has all static transforms: read {SPLIT}/robot_0.bag, too. '
        'More: tf_doctor --explain split_bag')


@pytest.mark.parametrize('kind', ['mcap', 'db3', 'mcap file', 'mcap storage'])
def test_parts_by_their_names(tmp_path, monkeypatch, kind):
    """They are read in the order of the numbers, also more than ten of them."""
    monkeypatch.chdir(tmp_path)
    files = parts(tmp_path / 'robot', kind)
    assert counts([*reversed(files), files[0].relative_to(tmp_path)]) == WHOLE
    assert counts(f'{tmp_path}/robot/robot_*') == WHOLE
    (eleventh,) = parts(tmp_path / 'robot', kind, [10])
    (tmp_path / 'robot' / 'notes.txt').write_text('Dear diary')
    for given in tmp_path / 'robot', f'{tmp_path}/robot/robot_*':
        assert recordings(given) == [[*files, eleventh]]


def test_parts_by_metadata(tmp_path):
    """A metadata.yaml gives the order, whatever the names are; other files are left out."""
    first, *others = parts(tmp_path)
    files = [others[0].rename(tmp_path / 'b.mcap'), others[1].rename(tmp_path / 'a.mcap')]
    whole, files = with_metadata(tmp_path / 'whole', [first, *files])
    (whole / 'other.mcap').write_bytes(b'Dear diary')
    for given in whole, files, reversed(files), whole / 'metadata.yaml', f'{whole}/[abr]*.mcap':
        assert counts(given) == WHOLE
    assert recordings(f'{whole}/*') == [[whole], [whole / 'other.mcap']]
    assert recordings([*files, whole / 'other.mcap']) == [files, [whole / 'other.mcap']]
    unlisted = files[0].with_name('robot_1.mcap')
    unlisted.write_bytes(files[0].read_bytes())
    assert recordings([*files, unlisted]) == [files, [unlisted]]
    assert recordings(whole) == [[whole]]
    assert missing_part(whole) == ''
    assert missing_part(files[1:]).endswith(f'read {files[0]}, too.')


def test_a_part_that_is_missing(tmp_path):
    """It is an error, unless partial=True reads the others."""
    whole, (_, second, _) = with_metadata(tmp_path / 'whole', parts(tmp_path))
    for change, why in ((second.unlink, 'it is missing'),
                        (second.touch, 'it is not a bag: it is empty')):
        change()
        with pytest.raises(BagError, match=(
                rf'cannot be read: robot_1\.mcap: {why}\. partial=True reads what is left\. ')):
            read(whole)
        assert counts(whole, partial=True) == {'odom': 1, 'base_link': 62}
    for file in whole.glob('*.mcap'):
        file.unlink()
    with pytest.raises(BagError, match=r'whole cannot be read: robot_0\.mcap: it is missing\. M'):
        read(whole)


def test_a_part_that_was_renamed(tmp_path):
    """The error names the file that is there; the remedy is executed."""
    path = shutil.copytree(DATA / 'renamed_bag', tmp_path / 'bag')
    with pytest.raises(BagError, match=(
            r'missing: renamed_bag\.db3; give its files in place of the directory: my_run\.db3$')
    ) as caught:
        read(path, partial=True)
    assert sum(counts(path / str(caught.value).rpartition(': ')[2]).values()) == 20


def test_a_pointer_of_git_lfs():
    """It stands for a file that was not downloaded."""
    with pytest.raises(BagError, match='it is a Git LFS pointer: git lfs pull'):
        read(DATA / 'lfs_pointer.mcap')


def test_an_index_that_rosbags_does_not_expect(tmp_path):
    """As of a bag of 2010: the error is more than the name of an exception."""
    path = bags.file_of(bags.make(tmp_path / 'old', 'bag', bags.walk(1)))
    time = struct.pack('<II', 100, 1_000_000)
    path.write_bytes(re.sub(b'(?<!time=)' + time, struct.pack('<II', 100, 7), path.read_bytes()))
    with pytest.raises(BagError, match=(
            r'the library that reads it expects \(AssertionError\)\. partial=True reads what')):
        read(path)
    read(path, partial=True)


def test_several_recordings(tmp_path):
    """They are sorted by the order of the paths; one buffer holds only one of them."""
    walk, again = (bags.make(tmp_path / name, 'mcap', bags.walk(1)) for name in ('b', 'a'))
    single = bags.make(tmp_path / 'single.bag', 'bag', bags.walk(1))
    files = parts(tmp_path / 'split')
    assert recordings([walk, files[1], single, again, files[0], files[2]]) == [
        [walk], files, [single], [again]]
    assert recordings(tmp_path) == [[again], [walk], [single]]  # no files in directories
    with pytest.raises(BagError, match=r'these are 2 recordings \(\S*b, \S*a\): give the files'):
        read([walk, again])


def test_the_last_part_is_not_compressed_yet(tmp_path):
    """rosbag2 compresses a file when it begins the next one, so it may be killed before."""
    first, second, last = parts(tmp_path / 'robot')
    packed = parts(tmp_path / 'other', 'mcap file', [0, 1])
    first.unlink()
    second.unlink()
    for file in packed:
        file.rename(tmp_path / 'robot' / file.name)
    assert counts(tmp_path / 'robot') == WHOLE
    assert missing_part(last).endswith(f'read {tmp_path}/robot/robot_0.mcap.zstd, too.')


def test_a_first_part_that_is_missing(tmp_path, logs):
    """Of a directory read with partial=True, it is named, too; the log warns once."""
    whole, (first, *_) = with_metadata(tmp_path / 'whole', parts(tmp_path))
    first.unlink()
    with bag.open(whole, partial=True) as opened, pytest.raises(
            LookupException, match=f'whole is without the first part .*{first} does not exist: '):
        opened.read().lookup_transform('base_link', 'laser')
    assert str(first) in opened.missing_part
    assert [record.getMessage() for record in logs] == [
        f'{first}: it is missing. Read 62 TF messages']


def test_a_part_is_a_remedy_only_if_it_exists(tmp_path, logs):
    """A first part that has another name gets its name back, or is lost."""
    first, second, last = parts(tmp_path)
    other = first.rename(tmp_path / 'start.mcap')
    text = missing_part(last)
    assert text.endswith(f': {first} does not exist: rename it back, or they are lost.')
    other.rename(first)
    text = missing_part(last)
    assert text.endswith(f': read {first}, too.')
    assert counts([text.split()[-2].rstrip(','), second, last]) == WHOLE
    second.unlink()
    logs.clear()
    missing_part([first, last])
    assert [record.getMessage() for record in logs] == [
        f'{first}: parts of its recording are not given, or missing: robot_1.mcap']


def test_parts_without_the_first(tmp_path):
    """They may be separate recordings; with the first part, they are one."""
    files = parts(tmp_path, numbers=(1, 2))
    with pytest.raises(BagError, match=(
            r'these are 2 recordings .*: give the files of one$')):
        read(files)
    assert counts(files[:1]) == {'base_link': 31}
    assert counts([*files, *parts(tmp_path, numbers=[0])]) == WHOLE


def test_names_that_rosbag_chooses(tmp_path):
    """Each part has a time of its own, so the name of the first part is not known."""
    for number, name in enumerate(('x_2026-01-01-00-00-00_0', 'x_2026-01-01-00-01-00_1')):
        shutil.copy(SPLIT / f'robot_{number}.bag', tmp_path / f'{name}.bag')
    assert len(recordings(tmp_path)) == 2
    assert missing_part(tmp_path / f'{name}.bag') == ''


@pytest.mark.parametrize('names', [
    ('run_001.mcap', 'run_002.mcap'), ('run_1.mcap', 'run_2.mcap'), ('run1.mcap', 'run2.mcap')])
def test_files_that_are_no_parts(tmp_path, names):
    """Numbers that rosbag2 does not write are those of separate recordings."""
    files = [file.rename(tmp_path / name) for file, name in zip(parts(tmp_path / 'x'), names)]
    assert recordings(files) == [[file] for file in files]


def test_a_later_part_with_static_transforms(tmp_path):
    """Some recorders repeat them; then nothing is missing."""
    (file,) = parts(tmp_path, numbers=[0])
    later = file.rename(tmp_path / 'robot_3.mcap')
    with pytest.raises(LookupException, match=(
            r"Known frames: 'odom', 'map', 'base_link'\. More: tf_doctor --explain missing_")):
        read(later).lookup_transform('map', 'laser')


def test_a_later_part_without_transforms(tmp_path):
    """The error names the first part."""
    path = bags.file_of(bags.make(tmp_path / 'x', 'mcap', [])).rename(tmp_path / 'robot_1.mcap')
    with pytest.raises(BagError, match=r'robot_1\.mcap has no TF: .* first part .*robot_0\.mcap'):
        read(path)


# Recordings of the real rosbag2 0.26, with the arm and robot_state_publisher

RECORDINGS = Path(__file__).parents[1] / 'data' / 'recordings'


def metadata_of(name):
    """Return the begin and the end (ns) of a recording, and the counts of its topics."""
    text = YAML(typ='safe').load((RECORDINGS / name / 'metadata.yaml').read_text())
    about = text['rosbag2_bagfile_information']
    begin = about['starting_time']['nanoseconds_since_epoch']
    return begin, begin + about['duration']['nanoseconds'], {
        each['topic_metadata']['name']: (each['topic_metadata']['type'], each['message_count'])
        for each in about['topics_with_message_count']}


@pytest.mark.parametrize('name', [
    'db3_plain', 'db3_message_zstd', 'mcap_chunk_zstd', 'mcap_file_zstd', 'mcap_split'])
def test_a_recording_of_rosbag2(name, logs):
    """Topics, counts, begin and end are those of its metadata; all is read in one pass."""
    begin, end, topics = metadata_of(name)
    others = [('std_msgs/msg/String', 'robot_description')]
    with bag.open(RECORDINGS / name) as opened:
        assert {topic.name: (topic.msgtype, topic.count) for topic in opened.topics} == topics
        assert (opened.begin, opened.end) == (begin, end)
        found: list[bag.BagMessage] = []
        buffer = opened.read(headers=True, others=others, on_message=found.append)
        headers = {topic.name: topic.headers.count for topic in opened.topics
                   if topic.headers.count}
        assert {topic.name: (topic.msgtype, topic.count) for topic in opened.topics} == topics
    counted = Counter(message.topic.name for message in found)
    assert counted | headers == {name: count for name, (_, count) in topics.items()}
    assert [*headers] == ['/joint_states']
    assert all(begin <= message.time <= end for message in found)
    (text,) = (message.decoded() for message in found if not message.topic.is_tf)
    assert text.data.startswith('<')
    assert {frame.name for frame in buffer.frames() if frame.is_static} == {'base_link'}
    assert {topic.name: [*topic.durabilities] for topic in opened.topics if topic.is_tf} == {
        '/tf': ['VOLATILE'], '/tf_static': ['TRANSIENT_LOCAL']}
    assert not logs


def test_parts_of_a_recording_of_rosbag2(logs):
    """In any order; if only some are given, it is said which are missing."""
    files = [RECORDINGS / 'mcap_split' / f'mcap_split_{i}.mcap' for i in range(4)]
    with bag.open([files[i] for i in (2, 0, 3, 1)]) as opened:
        assert opened.files == files
        assert opened.read().frames() == read(files[0].parent).frames()
        assert {topic.name: topic.count for topic in opened.topics} == {
            name: count for name, (_, count) in metadata_of('mcap_split')[2].items()}
    with bag.open(files[1:]) as opened:
        assert opened.missing_part.endswith(f'read {files[0]}, too.')
        assert not any(frame.is_static for frame in opened.read().frames())
    with bag.open([files[3], files[0], files[2]]) as opened:
        assert opened.files == [files[0], files[2], files[3]]
        assert opened.missing_part == ''
        times = [message.time for message in opened.messages()]
    assert times == sorted(times)
    assert [record.getMessage() for record in logs] == [
        f'{files[0]}: parts of its recording are not given, or missing: mcap_split_1.mcap']


def test_a_window_of_a_recording():
    """Messages outside of it are left out, except static transforms."""
    begin = metadata_of('mcap_chunk_zstd')[0]
    start, stop = begin + 2 * S, begin + 3 * S
    with bag.open(RECORDINGS / 'mcap_chunk_zstd') as opened:
        whole = [*opened.messages()]
        found = [*opened.messages(start=start, stop=stop)]
    assert [each.data for each in found] == [
        each.data for each in whole if each.is_static or start <= each.time < stop]
    assert 15 < len(found) < 25 < len(whole)
