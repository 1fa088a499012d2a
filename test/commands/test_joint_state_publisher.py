"""The command `joint_state_publisher`: what its sliders publish, and what it says."""

from contextlib import closing
from math import pi
import signal

from cli_runner import call, once
from processes import tool
import pytest
from rclpy.time import Time
from sensor_msgs.msg import JointState

from puretf_tools.commands.joint_state_publisher import main
from puretf_tools.robot import description_listener
from puretf_tools.robot.state_publisher import RobotStatePublisher

pytest.importorskip('viser')
from viewer import Viewer

URDF = """
<robot name="lift">
  <link name="base"/><link name="arm"/><link name="finger"/><link name="car"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1.5" upper="0.5" effort="1" velocity="1"/>
  </joint>
  <joint name="grip" type="revolute">
    <parent link="arm"/><child link="finger"/><limit lower="-9" upper="9" effort="1" velocity="1"/>
    <mimic joint="shoulder" multiplier="-2" offset="0.25"/>
  </joint>
  <joint name="lift" type="prismatic">
    <parent link="base"/><child link="car"/><axis xyz="0 0 1"/>
    <limit lower="0.5" upper="1.5" effort="1" velocity="1"/>
  </joint>
</robot>"""


@pytest.fixture
def urdf(tmp_path):
    """The path of a robot with a mimic joint."""
    path = tmp_path / 'lift.urdf'
    path.write_text(URDF)
    return str(path)


@pytest.fixture
def positions(ros):
    """The positions that are received, by joint."""
    found: dict[str, float] = {}
    ros.node.create_subscription(
        JointState, '/joint_states',
        lambda state: found.update(zip(state.name, state.position, strict=True)), 10)
    return found


def open_page(process):
    """Return a viewer of the page of a process."""
    return closing(Viewer(process.port()))


def test_the_joints_of_a_file(start, ros, urdf, positions):
    """A slider moves its joint and the one that follows it, within the limits, at any rate."""
    process = start(*tool('joint_state_publisher', urdf, '--ros-args', '-p', 'rate:=50'))
    with open_page(process) as viewer:
        ros.until(lambda: positions == {'shoulder': 0.0, 'grip': 0.25, 'lift': 1.0})
        viewer.until(lambda: 'lift (m)' in {props.get('label') for props in viewer.gui.values()})
        viewer.set('shoulder (°)', -45.0)
        ros.until(lambda: positions['shoulder'] == pytest.approx(-pi / 4))
        assert positions['grip'] == pytest.approx(pi / 2 + 0.25)
        viewer.set('lift (m)', 99.0)
        ros.until(lambda: positions['lift'] == 1.5)
        viewer.set('Move', 'Centre')
        ros.until(lambda: positions == {'shoulder': 0.0, 'grip': 0.25, 'lift': 1.0})
    process.end_normally(signal.SIGTERM)
    assert process.output.count('\n') == 1


@pytest.mark.parametrize('name', ['meshes/hand.stl', '../meshes/hand.stl'])
def test_meshes_beside_the_file(start, tmp_path, name):
    """Their names are relative to the file, whatever the current directory is."""
    file = tmp_path / 'robot' / 'urdf' / 'r.urdf'
    mesh = file.parent / name
    mesh.parent.mkdir(parents=True)
    mesh.write_text('solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n'
                    'vertex 0 1 0\nendloop\nendfacet\nendsolid a\n')
    file.parent.mkdir(exist_ok=True)
    file.write_text(f'<robot name="r"><link name="base"/><link name="hand"><visual><geometry>'
                    f'<mesh filename="{name}"/></geometry></visual></link><joint name="j" '
                    'type="fixed"><parent link="base"/><child link="hand"/></joint></robot>')
    start(*tool('robot_state_publisher', 'robot/urdf/r.urdf'), cwd=tmp_path)
    process = start(*tool('joint_state_publisher', 'robot/urdf/r.urdf'), cwd=tmp_path)
    with open_page(process) as viewer:
        viewer.until(lambda: any('vertices' in node for node in viewer.nodes.values()))


def test_the_robot_of_the_network(start, ros, listening, urdf):
    """Without a file, the description is that of robot_state_publisher, whose robot moves."""
    process = start(*tool('joint_state_publisher'))
    process.line_with('waiting for a robot description on /robot_description')
    with open_page(process) as viewer:
        viewer.until(lambda: 'start robot_state_publisher FILE' in viewer.text('joints'))
        start(*tool('robot_state_publisher', urdf))
        viewer.until(lambda: 'lift (m)' in {props.get('label') for props in viewer.gui.values()})
        viewer.set('lift (m)', 1.25)
        ros.until(lambda: listening.can_transform('base', 'car', Time()) and (
            listening.lookup_transform('base', 'car', Time()).transform.translation.z == 1.25))
    process.end_normally()


def test_with_a_file_no_description_of_the_network_is_parsed(domain_id, urdf, monkeypatch):
    """Nothing listens to them."""
    monkeypatch.setattr(description_listener, 'DescriptionListener', None)
    result = call(main, urdf, domain=domain_id, until=lambda text: 'look at http' in text)
    assert result.code == 0, result


def test_another_publisher_is_named(start, ros, urdf):
    """Once in the log, and in the panel until it has left."""
    other = ros.node.create_publisher(JointState, '/joint_states', 10)
    process = start(*tool('joint_state_publisher', urdf))
    with open_page(process) as viewer:
        viewer.until(lambda: '/test publishes on /joint_states, too' in viewer.text('joints'))
        process.line_with('/test publishes on /joint_states, too')
        ros.node.destroy_publisher(other)
        viewer.until(lambda: 'The positions are sent on /joint_states' in viewer.text('joints'))


def test_a_namespace(ros, make_node):
    """The topics are in it."""
    make_node(URDF, kind=RobotStatePublisher, namespace='left', is_spun=True)
    states: list[JointState] = []
    ros.node.create_subscription(JointState, '/left/joint_states', states.append, 10)
    with ros.spinning():
        assert call(main, '--namespace', 'left', domain=ros.domain,
                    until=once(lambda: states)).code == 0
    assert states[0].name == ['shoulder', 'grip', 'lift']


@pytest.mark.parametrize('rate', ['0', '-1.0', '1001', '.nan', 'fast', 'true'])
def test_a_rate_that_is_none(domain_id, urdf, rate):
    """It is refused in one line."""
    code, output, error = call(main, urdf, '--ros-args', '-p', f'rate:={rate}', domain=domain_id)
    assert (code, output, error.count('\n')) == (2, '', 1)
    assert error.startswith('joint_state_publisher: rate must be a number from 0.1 to 1000 Hz, ')
