"""Descriptions from files and xacro: what is read, and remedies that work."""

import re
import shutil
import subprocess
import sys

from environment import code_without, DATA, ROS
import pytest

from puretf._text.distribution import distribution
from puretf_tools.robot import DescriptionError, parse, read

ROBOTS = DATA / 'robots'


@pytest.fixture
def robots(tmp_path, monkeypatch):
    """A directory with copies of the descriptions, without a ROS environment."""
    pytest.importorskip('xacro')
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    return shutil.copytree(ROBOTS, tmp_path / 'robots')


def refused(path, *arguments):
    """Return the error of a file."""
    with pytest.raises(DescriptionError) as caught:
        read(path, *arguments)
    assert str(caught.value).isprintable()
    return str(caught.value)


def test_dirname_is_left_out(robots):
    """Xacro 2.1.1 does not know it; the remedy is executed."""
    file = robots / 'top.urdf.xacro'
    error = refused(file)
    assert 'Cannot substitute $(dirname)' in error
    left_out, = re.findall(r"leave out '(.*)': names are relative to the file$", error)
    file.write_text(file.read_text().replace(left_out, ''))
    assert '<link name="wheel"/>' in read(file)


def test_a_file_that_is_included_is_named(robots):
    """The error is in it, not in the outermost file."""
    assert refused(robots / 'top_bad.urdf.xacro') == (
        f"xacro cannot expand {robots}/part_bad.xacro, included from {robots}/top_bad.urdf.xacro: "
        "name 'side' is not defined when evaluating expression 'side'")


def test_a_macro_of_another_file_is_named(robots):
    """Xacro has left the file that defines it when it is used."""
    part = robots / 'part_bad.xacro'
    part.write_text(part.read_text().replace('<link', '<xacro:macro name="wheel"><link').replace(
        '</robot>', '</xacro:macro></robot>'))
    top = robots / 'top_bad.urdf.xacro'
    top.write_text(top.read_text().replace('<link name="base"/>', '<xacro:wheel/>'))
    assert refused(top).startswith(
        f"xacro cannot expand macro wheel of {part}, used in {top}: name 'side' is not defined")


def test_an_argument_of_xacro(robots):
    """A missing one is named, with the form that the commands take."""
    file = robots / 'arg.urdf.xacro'
    assert refused(file).endswith(
        f'Undefined substitution argument arm_type; write {file} arm_type:=VALUE')
    assert parse(read(file, {'arm_type': 'ur5e'})).links == ('ur5e_base',)


@pytest.mark.parametrize(('prefix', 'cause'), [
    ('', "Environment variable 'AMENT_PREFIX_PATH' is not set"),
    ('/any/prefix', "package 'my_sensor_description' not found"), (None, 'ament_index_python')])
def test_a_package_that_is_not_found(robots, monkeypatch, prefix, cause):
    """The package or the variable is named; a path relative to the file works everywhere."""
    pytest.importorskip('ament_index_python')
    if prefix is None:
        monkeypatch.setitem(sys.modules, 'ament_index_python.packages', None)
    else:
        monkeypatch.setenv('AMENT_PREFIX_PATH', prefix)
    file = robots / 'find.urdf.xacro'
    error = refused(file)
    assert cause in error
    assert error.endswith(
        'in place of $(find PACKAGE), write a path relative to the file, or install the package '
        'and source the setup file of its workspace')
    (robots / 'sensor').mkdir()
    shutil.copy(robots / 'part.xacro', robots / 'sensor' / 'lidar.xacro')
    file.write_text(file.read_text().replace(
        '$(find my_sensor_description)/urdf/', '../robots/sensor/'))
    assert '<link name="wheel"/>' in read(file)


def test_a_package_that_is_installed(robots, monkeypatch):
    """The remedy "source the setup file of its workspace" sets this variable."""
    pytest.importorskip('ament_index_python')
    index, share = 'share/ament_index/resource_index/packages', 'share/my_sensor_description/urdf'
    for directory in index, share:
        (robots / directory).mkdir(parents=True)
    (robots / index / 'my_sensor_description').touch()
    shutil.copy(robots / 'part.xacro', robots / share / 'lidar.xacro')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(robots))
    assert '<link name="wheel"/>' in read(robots / 'find.urdf.xacro')


@pytest.mark.parametrize('is_installed', [True, False])
def test_a_leftover_of_xacro_is_ignored(robots, monkeypatch, is_installed):
    """Urdfdom 4.0.1 does so, too. The remedy of the only warning says what is wrong."""
    if not is_installed:
        monkeypatch.setitem(sys.modules, 'xacro', None)
    file = robots / 'leftover_xacro.urdf'
    description = parse(read(file))
    assert description.text == file.read_text()
    assert description.links == ('base', 'head')
    assert len(description.visuals) == 1
    assert description.warnings == (
        'elements of xacro are ignored: xacro:grey; in a file *.xacro, xacro expands them, or '
        'says why it cannot',)
    assert refused(file.rename(robots / 'leftover.xacro')).endswith(
        'unknown macro name: xacro:grey' if is_installed else
        f'xacro is missing: pip install xacro, or apt install ros-{distribution()}-xacro')


def test_elements_of_xacro_in_any_file_are_expanded(robots):
    """If that is possible; a comment has no elements."""
    file = robots / 'leftover_xacro.urdf'
    text = file.read_text().replace('<xacro:grey/>', '<!-- <xacro:if value="1"> -->')
    file.write_text(text)
    assert read(file) == text
    file.write_text(text.replace('<link name="base"/>', (
        '<xacro:property name="a" value="base"/><link name="${a}"/>')))
    assert parse(read(file)).links == ('base', 'head')
    assert not parse(read(file)).warnings


def test_xacro_in_a_text_from_the_network_is_not_run():
    """A macro is a program."""
    description = parse('<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
                        '<xacro:include filename="/etc/passwd"/><link name="a"/></robot>')
    assert description.links == ('a',)
    assert len(description.warnings) == 1


@pytest.mark.parametrize(('mistake', 'remedy', 'mended'), [
    ('\n<?xml version="1.0"?>', 'remove what stands before <?xml', '<?xml version="1.0"?>'),
    ('<!-- a -- b -->', 'remove -- from its text', '<!-- a  b -->')])
def test_a_mistake_in_a_file_of_xacro(robots, mistake, remedy, mended):
    """Xacro refuses what tinyxml2 overlooks; the error says what to change."""
    file = robots / 'part.xacro'
    text = file.read_text().partition('?>')[2]
    file.write_text(mistake + text)
    assert refused(file).endswith(remedy)
    file.write_text(mended + text)
    assert '<link name="wheel"/>' in read(file)


def test_a_prefix_in_a_file_of_xacro(robots):
    """Xacro refuses one without xmlns."""
    file = robots / 'part.xacro'
    text = file.read_text().replace('</robot>', '<gz:a/><![CDATA[<b>]]></robot>')
    file.write_text(text)
    remedy, = re.findall('; declare it in <robot>: (.*)', refused(file))
    file.write_text(text.replace('<robot', '<robot ' + remedy.replace('PREFIX', 'gz')))
    assert '<![CDATA[<b>]]>' in read(file)


def test_nothing_is_needed_to_parse():
    """Neither ROS nor a package of URDF or YAML: the page of a bag draws robots by this."""
    code = code_without([*ROS, 'urdf_parser_py', 'xacro', 'yaml', 'lxml']) + (
        'from puretf_tools.robot import parse, read\n'
        'print(parse(read(sys.argv[1])).visuals[0].kind)')
    done = subprocess.run([sys.executable, '-c', code, ROBOTS / 'geometry_two.urdf'], text=True,
                          timeout=60, capture_output=True, check=True)
    assert done.stdout == 'box\n'
