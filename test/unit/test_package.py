"""The package as a whole: metadata, commands, names."""

import ast
from importlib import import_module
import pydoc
import re
import subprocess
import sys
from xml.etree import ElementTree

from environment import code_without, COMMANDS, ROOT, ROS
import pytest

import puretf
from puretf import bag, Frame, Transform, TransformBuffer, Twist
from puretf._text import distribution


def test_setup_py_and_package_xml_agree():
    """Name, version, description, licence and maintainer are the same in both files."""
    done = subprocess.run(
        [sys.executable, 'setup.py', '--name', '--version', '--description', '--license',
         '--maintainer', '--maintainer-email'],
        cwd=ROOT, text=True, capture_output=True, check=True, timeout=60)
    xml = ElementTree.parse(ROOT / 'package.xml')
    maintainer = xml.find('maintainer')
    assert maintainer is not None
    assert done.stdout.splitlines()[-6:] == [
        *(xml.findtext(tag) for tag in ('name', 'version', 'description', 'license')),
        maintainer.text, maintainer.get('email')]


def test_the_page_of_tf_doctor_is_in_sdist_and_wheel(tmp_path):
    """The package has the page that `tf_doctor --explain` prints."""
    subprocess.run([sys.executable, 'setup.py', '-q', 'egg_info', '--egg-base', str(tmp_path),
                    'build', '--build-base', str(tmp_path)],
                   cwd=ROOT, capture_output=True, check=True, timeout=60)
    page = ROOT / 'docs' / 'troubleshooting.md'
    (installed,) = (tmp_path / 'lib').rglob(page.name)
    assert installed == tmp_path / 'lib' / 'puretf_tools' / 'doctor' / page.name
    assert installed.read_text() == page.read_text()
    sources = tmp_path / 'dummy_arm.egg-info' / 'SOURCES.txt'
    assert 'docs/troubleshooting.md' in sources.read_text().splitlines()


def test_the_changelog_has_this_version():
    """It has a section for the version, in the form that catkin_prepare_release reads."""
    version = ElementTree.parse(ROOT / 'package.xml').findtext('version')
    assert version
    changelog = (ROOT / 'CHANGELOG.rst').read_text()
    heading = rf'^({re.escape(version)} \(\d{{4}}-\d\d-\d\d\)|Forthcoming)\n-+\n\* '
    assert re.search(heading, changelog, re.MULTILINE)


def test_a_program_for_version_0_3_is_migrated_by_the_command_of_the_changelog(tmp_path):
    """After the command, it imports the same objects from the new packages."""
    (command,) = re.findall(r'``(sed .*) program\.py``', (ROOT / 'CHANGELOG.rst').read_text())
    program = tmp_path / 'program.py'
    program.write_text('from dummy_arm import tf\nimport dummy_arm.tf.rotations\n'
                       'from dummy_arm.tf import Transform\nfrom dummy_arm.robot import parse\n'
                       'from dummy_arm.doctor import examine\n'
                       'assert tf.Transform is Transform is dummy_arm.tf.Transform\n')
    subprocess.run(f'{command} {program}', shell=True, check=True, timeout=60)
    subprocess.run([sys.executable, program], check=True, timeout=60)


def test_the_reference_has_all_public_modules():
    """Each module that has names beside those of puretf is in it; Sphinx looks for names."""
    pages = (ROOT / 'docs' / 'reference').glob('*.rst')
    reference = ''.join(page.read_text() for page in pages)
    modules = {path.stem for path in (ROOT / 'puretf').glob('[a-z]*.py')}
    assert modules == puretf._PUBLIC_MODULES
    for module in modules - set(puretf._NAMES):
        assert f'.. automodule:: puretf.{module}\n' in reference


def test_the_public_names():
    """They are at most 34, in the same modules for type checkers, and lead to no private one."""
    pytest.importorskip('rclpy', reason='some of these modules need ROS')
    assert len(puretf.__all__) <= 34
    source = ast.parse((ROOT / 'puretf' / '__init__.py').read_text())
    typed = {f'{node.module}.{name}' for node in ast.walk(source)
             if isinstance(node, ast.ImportFrom) and str(node.module).startswith('puretf.')
             for each in node.names for name in (
                 import_module(str(node.module)).__all__ if each.name == '*' else [each.name])}
    assert typed == {f'puretf.{module}.{name}' for name, module in puretf._MODULES.items()}


def test_what_needs_ros_says_so():
    """Names and modules do; `import *` and `help` leave them out."""
    code = code_without(ROS) + """
import puretf
for each in (
        'puretf.Transform(0, "a", "b").to_message()', 'from puretf import TransformListener',
        *(f'import puretf.{name}' for name in puretf._PUBLIC_MODULES - puretf._USABLE)):
    try:
        exec(each)
    except ModuleNotFoundError as error:
        print(error)
from puretf import *
print(TransformBuffer.__name__, 'Buffer' in globals(), 'geometry' in dir(puretf))
help(puretf)
"""
    lines = subprocess.run([sys.executable, '-c', code], text=True,
                           capture_output=True, check=True, timeout=60).stdout.splitlines()
    assert [line.partition(' is not installed: ')[0] for line in lines[:12]] == [
        f'this needs ROS, but {name}' for name in ('geometry_msgs', *['rclpy'] * 11)]
    assert lines[12] == 'TransformBuffer False False'


@pytest.mark.parametrize(('system', 'processor', 'text'), [
    ('linux', 'x86_64', r"pip install 'ros-\w+-rclpy\[fastrtps\]' ros-\w+-common-interfaces, or "
     'source .*'),
    ('linux', 'aarch64', r'.*\(RoboStack, https://robostack.github.io\)'),
    ('darwin', 'arm64', '.* conda .*')])
def test_how_to_install_ros(monkeypatch, system, processor, text):
    """PyPI has wheels of rclpy for one platform only."""
    monkeypatch.setattr(sys, 'platform', system)
    monkeypatch.setattr(distribution, 'machine', lambda: processor)
    assert re.fullmatch(text, distribution.how_to_install_ros())


def test_array_arguments_are_array_like():
    """In `help`, they are not the unions that the name stands for."""
    shown = pydoc.plain(pydoc.render_doc(TransformBuffer)) + pydoc.plain(
        pydoc.render_doc(Transform))
    assert "stamps: 'ArrayLike | Sequence[Any]'" in shown
    assert '_NestedSequence' not in shown


@pytest.mark.parametrize('cls', [Frame, Transform, Twist, bag.Headers, bag.Topic])
def test_help_has_the_fields(cls):
    """It prints no comments; some names say all."""
    fields = {name for name in getattr(cls, '__annotations__', None) or vars(cls())
              if name[0] != '_'} - {'name', 'parent', 'encoding', 'is_wanted', 'is_read'}
    help_text = pydoc.plain(pydoc.render_doc(cls))
    assert fields
    assert fields <= {*re.findall(r':(?:param|ivar) (\w+): ', help_text)}


def test_every_command_is_installed():
    """Each command is an entry point in setup.py."""
    setup = (ROOT / 'setup.py').read_text()
    for command in COMMANDS:
        assert f"'{command}'" in setup


def test_a_command_that_needs_ros_says_so():
    """Without ROS, each command prints one line with the remedy, and exits with code 1."""
    arguments = {'param': ['node'], 'tf2_echo': ['map', 'odom'], 'tf_trajectory': ['map', 'odom']}
    lines = {name: [name, *arguments.get(name, [])] for name in COMMANDS}
    code = code_without(ROS) + f"""
from importlib import import_module
for name, sys.argv in {lines}.items():
    try:
        package = {COMMANDS}[name].partition('.')[0]
        code = getattr(import_module(package + '.entry_points'), name)()
    except SystemExit as end:
        code = end.code
    print(name, code)
"""
    done = subprocess.run([sys.executable, '-c', code], text=True, capture_output=True, check=True,
                          timeout=60)
    assert done.stdout.splitlines() == [f'{name} 1' for name in COMMANDS]
    for name, line in zip(COMMANDS, done.stderr.splitlines(), strict=True):
        assert re.fullmatch(rf'{name}: this command needs ROS, but \w+ cannot be imported: pip '
                            'install .*', line)


def test_names_of_tf_are_listed_and_unknown_ones_are_not_there():
    """Names that are imported late appear in dir(); other names raise AttributeError."""
    assert {'TransformBuffer', 'bag'} <= set(dir(puretf))
    with pytest.raises(AttributeError, match="no attribute 'Nonsense'"):
        _ = puretf.Nonsense
