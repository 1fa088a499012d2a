"""docs/troubleshooting.md: each of its symptoms is provoked, and leads to its section."""

from pathlib import Path
import re
from tempfile import TemporaryDirectory

from environment import ROOT
from pages import PAGES
import pytest
from recorded import S, T

from puretf import bag, TransformBuffer, TransformException
from puretf._causes.lookups import RULES
from puretf._text.names import SECTIONS
from puretf_tools.commands.tf_doctor import main
from puretf_tools.doctor.checks import CHECKS

PAGE = (ROOT / 'docs' / 'troubleshooting.md').read_text()
STILL = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
#: By heading: the other cells of the row.
ROWS = {heading: (cause, re.findall('`([a-z_0-9]+)`', codes)) for heading, cause, codes in
        re.findall(r'^\| \[(.*?)\]\(.*?\) \| (.*?) \| (.*?) \|$', PAGE, re.M)}


def error_of(source='base', time=0, stamps=range(0, 20)):
    """Return the text of the error of a lookup."""
    buffer = TransformBuffer(cache_time=10 * S)
    for second in stamps:
        buffer.insert(T + second * S, 'map', 'base', STILL)
    buffer.insert(0, 'world', 'lamp', STILL, is_static=True)
    if not stamps:
        buffer.insert(T, 'map', 'base', STILL)
        buffer.clear()
    with pytest.raises(TransformException) as raised:
        buffer.lookup_transform('map', source, T + time * S if time else 0)
    return str(raised.value)


def error_of_bag():
    """Return the error of a file that is cut off."""
    bags = pytest.importorskip('bags')
    with TemporaryDirectory() as folder:
        path = bags.checked_mcap(Path(folder, 'x.mcap'), seconds=10)
        path.write_bytes(path.read_bytes()[:-1000])
        with pytest.raises(bag.BagError) as raised:
            bag.read(path)
    return str(raised.value)


def old_data(logs):
    """Return the warning about a transform that is too old."""
    buffer = TransformBuffer(cache_time=10 * S)
    for stamp in T, T - 20 * S:
        buffer.insert(stamp, 'map', 'base', STILL, '/arm')
    return '\n'.join(record.getMessage() for record in logs)


#: By heading of what errors and logs say in tf2's words: a function that returns the text, and
#: the words of the symptom in it.
PROVOKED = {
    'Extrapolation into the future': (
        lambda _: error_of(time=20), 'Lookup would require extrapolation into the future'),
    'Extrapolation into the past': (
        lambda _: error_of(time=5), 'Lookup would require extrapolation into the past'),
    'Only one time is in the buffer': (
        lambda _: error_of(time=5, stamps=[1]), 'only time 1700000001.000000 is in the buffer'),
    'A frame does not exist': (lambda _: error_of('bsae'), '"bsae" passed to'),
    'Two unconnected trees': (lambda _: error_of('lamp'), 'two or more unconnected trees'),
    'TF_OLD_DATA': (old_data, 'TF_OLD_DATA ignoring data from the past'),
    'A bag cannot be read': (lambda _: error_of_bag(), 'cannot be read: it ends too early.'),
    'A jump back in time': (
        lambda _: error_of(time=5, stamps=[]), 'since the buffer was cleared'),
}


#: By heading of a section: its short name.
NAMES = {heading: name for name, heading in SECTIONS.items()}


def codes_of(heading):
    """Return the codes of the findings that a section explains."""
    return {check.code for check in CHECKS.values() if SECTIONS[check.section] == heading}


def test_the_table_has_all_symptoms():
    """In the order of their sections; each is provoked here, or that of a rule."""
    headings = re.findall('^## (.*)$', PAGE, re.M)
    assert [*ROWS, 'Other faults'] == headings
    assert {*headings} == {*PROVOKED, *(
        SECTIONS[rule.section] for rule in (*RULES.values(), *CHECKS.values()))}
    for heading, (_, codes) in ROWS.items():
        assert codes or heading == 'A lookup that waits for its own node'
        assert {*codes} <= CHECKS.keys()
        assert {*codes} >= codes_of(heading)
        section = PAGE.split(f'\n## {heading}\n')[1].split('\n## ')[0]
        assert all(f'**{part}.**' in section for part in ('Cause', 'See it', 'Change'))
    others = PAGE.split('\n## Other faults\n')[1]
    assert codes_of('Other faults') == {*re.findall('`([a-z_0-9]+)`', others)}


def test_the_page_lists_the_codes_of_causes():
    """In alphabetical order, as those of `error.causes`."""
    listed = PAGE.split('The codes of causes are ')[1].split('. ')[0]
    assert re.findall('`(.*?)`', listed) == sorted(RULES)


def test_the_table_of_severities_has_all_codes():
    """In commands.md; some findings are less severe in some cases."""
    rows = re.findall(r'^\| (error|warning|info) \| (.*) \|$',
                      (ROOT / 'docs' / 'commands.md').read_text(), re.M)
    assert {code: severity for severity, codes in rows for code in re.findall('`(.*?)`', codes)
            } == {code: check.severity for code, check in CHECKS.items()}


@pytest.mark.parametrize('heading', PROVOKED)
def test_a_symptom_leads_to_its_section(logs, heading):
    """The error or the finding has the words of the symptom, and names the section."""
    provoke, words = PROVOKED[heading]
    text = ' '.join(provoke(logs).split())
    assert words in text
    assert f' More: tf_doctor --explain {NAMES[heading]}' in text


# tf_doctor --explain


def explained(capsys, *words):
    """Return what `tf_doctor --explain` prints."""
    assert main(['--explain', *words]) == 0
    return capsys.readouterr().out


def test_the_sections_are_listed(capsys):
    """In the order of the page, each with a short name of its own."""
    lines = [line.split(maxsplit=1) for line in explained(capsys).splitlines()]
    assert [heading for _, heading in lines] == re.findall('^## (.*)$', PAGE, re.M)
    assert [name for name, _ in lines] == [*SECTIONS]


@pytest.mark.parametrize('heading', NAMES)
def test_a_section_as_text(capsys, heading):
    """It has all words and code of the section, and nothing of Markdown but the quotes of code."""
    section = PAGE.split(f'\n## {heading}\n')[1].split('\n## ')[0]
    text = explained(capsys, NAMES[heading])
    assert text.startswith(f'{heading}\n\n')
    assert not re.search(r'\*\*|```|]\(|\n\n\n\n', text)
    plain = re.sub(r'\]\([^)]*\)|[][*]|```\w*', '', section)
    assert f'{heading} {plain}'.split() == re.sub(r'[][]', '', text).split()
    for code in re.findall(r'```python\n(.*?)```', section, re.S):
        assert ''.join(f'    {line}'.rstrip() + '\n' for line in code.splitlines()) in text


@pytest.mark.parametrize(('words', 'headings'), [
    (['two_trees'], ['Two unconnected trees']),
    (['leading', 'SLASH'], ['A leading slash, or a namespace']),
    (['extrapolation'], ['Extrapolation into the future', 'Extrapolation into the past']),
    (['future'], ['Extrapolation into the future']),  # the name, and not the code of a finding
    (['one_shot'], ['Only one time is in the buffer']),
    (['cache_too_short'], ['Extrapolation into the past']),  # of a cause only
    (['message_too_old'], ['Messages are earlier than all data in the cache']),
    (['loop'], ['Other faults'])])
def test_words_and_codes_lead_to_sections(capsys, words, headings):
    """A short name, a code of `--list` or some words of the headings, in upper or lower case."""
    lines = explained(capsys, *words).splitlines()
    assert [line for line in lines if line in NAMES] == headings


def test_every_code_leads_to_its_section(capsys):
    """The row of the section in the table of symptoms has the code; other faults have no row."""
    for code in CHECKS.keys() - SECTIONS.keys():
        heading, *lines = explained(capsys, code).splitlines()
        assert code in ROWS[heading][1] if heading in ROWS else f'`{code}`' in '\n'.join(lines)


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_the_names_in_the_pages_exist(page):
    """So a command that a page shows can be typed."""
    assert {*re.findall(r'tf_doctor --explain ([a-z]\w*)', page.read_text())} <= SECTIONS.keys()
