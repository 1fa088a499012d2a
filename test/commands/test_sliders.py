"""The sliders of web_view, for nodes that listen to a topic joint_command."""

from contextlib import closing, ExitStack
from math import pi, radians

from processes import ARM, tool
import pytest
from ros_node import LATCHED
from sensor_msgs.msg import JointState
from std_msgs.msg import String

pytest.importorskip('viser')
from viewer import Viewer

URDF = """
<robot name="robot">
  <link name="base"/><link name="wheel"/>
  <joint name="axle" type="continuous"><parent link="base"/><child link="wheel"/></joint>
</robot>"""


@pytest.fixture
def open_viewer(start):
    """A function that opens the page of a web_view."""
    with ExitStack() as stack:
        process = start(*tool('web_view'))
        port = process.port()

        def open_page():
            return stack.enter_context(closing(Viewer(port)))

        yield open_page
        process.end_normally()
        malformed = process.output.count('dropped a message on /left/joint_states that cannot be ')
        assert process.output.count('\n') - 1 == malformed <= 1


def labels(viewer):
    """Return the labels of the controls that are there."""
    return {props.get('label') for props in viewer.gui.values()}


def test_the_arm_holds_and_waves_again(start, ros, open_viewer):
    """The joint that a viewer moves is held; the others wave; another viewer sees all of it."""
    start(*ARM)
    states = []
    ros.node.create_subscription(
        JointState, '/joint_states', lambda state: states.append([*state.position]), 10)
    viewer, other = open_viewer(), open_viewer()
    for each in viewer, other:
        each.until(lambda each=each: 'joint_3 (°)' in labels(each))
    assert '/dummy_arm/joint_command' in viewer.text('joints')
    viewer.set('joint_2 (°)', -12.5)
    ros.until(lambda: len(states) > 10 and {each[1] for each in states[-10:]} == {radians(-12.5)})
    assert len({each[0] for each in states[-10:]}) == 10
    other.until(lambda: other.value('joint_2 (°)') == -12.5)
    other.set('Move', 'Centre')
    ros.until(lambda: states[-1] == [0.0] * 3)
    viewer.until(lambda: viewer.value('joint_2 (°)') == 0.0)
    viewer.set('Move', 'Wave')
    ros.until(lambda: 0.0 not in states[-1])
    for each in viewer, other:
        each.until(lambda each=each: each.value('joint_2 (°)') != 0.0)


def test_another_robot_in_a_namespace(ros, make_node, open_viewer):
    """It gets what the viewer moves, and nothing else; its sliders follow valid joint states."""
    robot = make_node('robot', namespace='left', is_spun=True)
    commands: list[JointState] = []
    subscription = robot.create_subscription(
        JointState, 'arm/joint_command', commands.append, 10)
    description = robot.create_publisher(String, 'robot_description', LATCHED)
    description.publish(String(data=URDF))
    states = robot.create_publisher(JointState, 'joint_states', 10)
    robot.create_timer(0.05, lambda: states.publish(
        JointState(name=['axle', 'other', 'axle'], position=[-pi / 2, 7.0])))
    # Seldom, as only the last message counts when the page looks.
    robot.create_timer(0.31, lambda: states.publish(b'\0\1\0\0' + b'\xff' * 40))
    # A recorder listens, too, and its namespace has another robot.
    recorder = ros.node.create_subscription(
        JointState, '/left/arm/joint_command', lambda _: None, 10)
    other = ros.node.create_publisher(String, '/robot_description', LATCHED)
    other.publish(String(data=URDF.replace('axle', 'wheel')))
    viewer = open_viewer()
    with ros.spinning():
        viewer.until(lambda: 'axle (°)' in labels(viewer))
        viewer.until(lambda: viewer.value('axle (°)') == -90.0)
        viewer.set('axle (°)', 45.0)
        viewer.until(lambda: commands)
        viewer.until(lambda: viewer.value('axle (°)') == -90.0)  # it has not obeyed
        ros.node.destroy_publisher(other)
        ros.node.destroy_subscription(recorder)
        robot.destroy_subscription(subscription)
        viewer.until(lambda: 'No node listens' in viewer.text('joints'))
    assert [(command.name, [*command.position]) for command in commands] == [
        (['axle'], [pytest.approx(pi / 4)])]
