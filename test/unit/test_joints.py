"""The sliders for the joints of robots, as viewers of the page move them."""

from contextlib import closing, ExitStack
from functools import partial
from html import unescape
from math import pi
import re
from typing import cast

import pytest

pytest.importorskip('viser')
from viewer import Viewer

from puretf_tools.robot.description import parse
from puretf_tools.robot.joint_senders import JointControl, JointControls
from puretf_tools.view.robot_tab import RobotTab
from puretf_tools.view.server import serve


def joint(name, kind, limits, more=''):
    """Return a joint from the link `base` to one of its own, in URDF."""
    limit = '<limit lower="{}" upper="{}" effort="1" velocity="1"/>'.format(*limits or (0, 0))
    return (f'<link name="to_{name}"/><joint name="{name}" type="{kind}"><parent link="base"/>'
            f'<child link="to_{name}"/>{limit}{more}</joint>')


def robot(*joints):
    """Return a robot."""
    return parse(f'<robot name="robot"><link name="base"/>{"".join(joints)}</robot>')


ARM = robot(
    joint('turn', 'revolute', (-pi / 2, pi / 4)), joint('slide', 'prismatic', (0.1, 0.35)),
    joint('wheel', 'continuous', None),
    joint('copy', 'revolute', (-9, 9), '<mimic joint="turn" multiplier="2"/>'))


class Arm(JointControl):
    """A robot that can wave."""

    can_wave, waves = True, 0

    def wave(self):
        """Count."""
        self.waves += 1


class Page:
    """A page with sliders only, for one or two viewers who share the robots."""

    why_none, warning = 'start it', ''

    def __init__(self, *controls):
        """Serve the page, and open it twice."""
        self._stack = ExitStack()
        self.controls = [*controls]
        self.server = self._stack.enter_context(serve('127.0.0.1'))
        self._joints = {}
        self.viewer, self.other = [self._stack.enter_context(closing(
            Viewer(self.server.get_port()))) for _ in range(2)]
        for viewer in self.viewer, self.other:
            viewer.until(partial(self.text, viewer), self.update)

    def __enter__(self):
        """Return the page."""
        return self

    def __exit__(self, *_):
        """End the server."""
        self._stack.close()

    def update(self):
        """Update the sliders of each viewer, as the page does."""
        for number, client in self.server.get_clients().items():
            if number not in self._joints:
                self._joints[number] = RobotTab(
                    client.gui, client.gui.add_folder('Robot'), cast(JointControls, self))
            self._joints[number].update([], [])

    def until(self, condition, viewer=None):
        """Update until a condition holds, which `viewer` sees."""
        (viewer or self.viewer).until(condition, self.update)

    def wait_for_sliders(self, number):
        """Update until both viewers have so many."""
        for viewer in self.viewer, self.other:
            self.until(lambda viewer=viewer: len(sliders(viewer)) == number, viewer)

    def text(self, viewer=None):
        """Return the text above the sliders."""
        found = (viewer or self.viewer).text('joints')
        return unescape(re.sub('<[^>]*>', '', found))


def sliders(viewer):
    """Return the properties of the sliders that are there, by label."""
    return {props['label']: props for props in viewer.gui.values() if 'precision' in props}


def test_a_slider_for_each_joint_that_can_be_set():
    """In degrees or m, between the limits; a joint that follows another one has none."""
    with Page(JointControl('/joint_states', ARM)) as page:
        page.wait_for_sliders(3)
        assert {label: [props[key] for key in ('min', 'max', 'step', 'value')]
                for label, props in sliders(page.viewer).items()} == {
            'turn (°)': [-90, 45, 0.1, 0], 'slide (m)': [0.1, 0.35, 1e-4, 0.225],
            'wheel (°)': [-180, 180, 0.1, 0]}
        assert page.text() == 'The positions are sent on /joint_states.'


def test_what_one_viewer_moves_the_other_sees():
    """Degrees become rad; 'Centre' moves all joints back."""
    control = JointControl('/joint_states', ARM)
    with Page(control) as page:
        page.wait_for_sliders(3)
        page.viewer.set('turn (°)', -90.0)
        page.viewer.set('slide (m)', 0.3)
        page.until(lambda: sliders(page.other)['slide (m)']['value'] == 0.3, page.other)
        assert sliders(page.other)['turn (°)']['value'] == -90.0
        assert control.positions.all() == {
            'turn': pytest.approx(-pi / 2), 'slide': 0.3, 'wheel': 0.0,
            'copy': pytest.approx(-pi)}
        page.other.set('Move', 'Centre')
        page.until(lambda: sliders(page.viewer)['turn (°)']['value'] == 0.0)
        page.until(lambda: sliders(page.viewer)['slide (m)']['value'] == 0.225)


def test_wrong_numbers_of_a_viewer():
    """They are clamped, and the slider of the other viewer shows what counts."""
    with Page(JointControl('/joint_states', ARM)) as page:
        page.wait_for_sliders(3)
        for value, shown in (1e9, 45.0), (-1e300, -90.0), (12.34, 12.3):
            page.viewer.set('turn (°)', value)
            page.until(lambda shown=shown: page.other.value('turn (°)') == shown, page.other)


def test_a_robot_that_moves_by_itself():
    """Its sliders follow; only a robot that can wave has the button."""
    control = Arm('/arm/joint_command', ARM)
    with Page(control) as page:
        page.wait_for_sliders(3)
        control.positions.set('wheel', -pi / 2)
        page.until(lambda: page.viewer.value('wheel (°)') == -90.0)
        page.viewer.set('Move', 'Wave')
        page.until(lambda: control.waves == 1)
        page.controls[:] = [JointControl('/joint_states', ARM)]
        page.until(lambda: page.viewer.get('Move', 'options') == ['Centre'])


def test_a_robot_that_leaves_while_it_is_moved():
    """What a viewer does with its controls has no effect any more."""
    control = Arm('/arm/joint_command', ARM)
    with Page(control) as page:
        page.wait_for_sliders(3)
        page.controls.clear()
        page.viewer.set('turn (°)', 20.0)
        page.viewer.set('Move', 'Centre')
        page.viewer.set('Move', 'Wave')
        page.until(lambda: page.text() == 'start it')
        assert (control.positions['turn'], control.waves) == (0.0, 0)


def test_many_joints():
    """The text says how many have no slider."""
    hand = robot(*(joint(f'joint_{i}', 'revolute', (-1, 1)) for i in range(230)))
    control = JointControl('/joint_states', hand)
    with Page(control) as page:
        page.wait_for_sliders(200)
        page.until(lambda: page.text() == (
            'The positions are sent on /joint_states. 30 more joints have no slider.'))
        page.viewer.set('joint_199 (°)', 10.0)
        page.until(lambda: control.positions['joint_199'] == pytest.approx(pi / 18))


def test_the_viewer_chooses_one_of_two_robots():
    """The sliders are those of the chosen one; the other one stays where it is."""
    arm = robot(joint('turn', 'revolute', (-1, 1)))
    one, two = (JointControl(f'/{name}/joint_command', arm) for name in ('one', 'two'))
    with Page(one, two) as page:
        page.wait_for_sliders(1)
        page.viewer.set('Joints of', two.topic)
        page.until(lambda: two.topic in page.text())
        page.viewer.set('turn (°)', 10.0)
        page.until(lambda: two.positions['turn'] == pytest.approx(pi / 18))
        assert one.positions['turn'] == 0.0
        page.controls.remove(two)
        page.until(lambda: one.topic in page.text())
        page.until(lambda: page.viewer.value('turn (°)') == 0.0)


def test_a_page_without_robots_says_what_to_do():
    """As it does when the last robot has left, or when another node publishes joint states."""
    control = JointControl('/joint_states', ARM)
    with Page() as page:
        assert page.text() == 'start it'
        page.controls.append(control)
        page.wait_for_sliders(3)
        page.warning = '/other publishes, <too>'
        page.until(lambda: page.text() == page.warning)
        page.controls.clear()
        page.until(lambda: page.text() == 'start it')
        page.until(lambda: not sliders(page.viewer))


def test_a_new_description_changes_the_sliders():
    """The joints stay where they are."""
    control = JointControl('/joint_states', ARM)
    with Page(control) as page:
        page.wait_for_sliders(3)
        page.viewer.set('turn (°)', 30.0)
        page.until(lambda: control.positions['turn'] > 0.5)
        control.set_description(robot(joint('turn', 'revolute', (-1, 1)),
                                      joint('&lt;b>', 'continuous', None)))
        page.until(lambda: {*sliders(page.viewer)} == {'turn (°)', '<b> (°)'})
        page.until(lambda: page.viewer.value('turn (°)') == 30.0)
