"""What browsers have stored, as a viewer of the page of web_view sends it, and a second viewer."""

from contextlib import closing, ExitStack, suppress

from hypothesis import given, Phase, settings
import pytest
from views import STORED

from puretf import TransformBuffer
from puretf_tools.view.feed import BagFeed

pytest.importorskip('viser')
from viewer import Page, Viewer

from puretf_tools.view.settings import Settings

S = 10**9


def test_1000_stored_views():
    """Each is shown or refused; the other viewer sees a bag play, and what is kept is right."""
    buffer, clock = TransformBuffer(2**63 - 1), [1000.0]
    for second in 0, 10_000:
        for child in 'base', '<b>':
            buffer.insert(second * S + 1, 'map', child, (float(second), *(0.0,) * 5, 1.0))
    with ExitStack() as stack:
        shown = Page(BagFeed(buffer, 'bag'), clock, stack)

        def places():
            return shown.viewer.axes('positions').tolist()

        def update():
            clock[0] += 0.01
            shown.view.update()
            with suppress(TimeoutError):
                shown.viewer.receive(0.001)

        @settings(max_examples=1000, phases=[Phase.explicit, Phase.generate])
        @given(STORED)
        def check(text):
            with closing(Viewer(shown.server.get_port())) as viewer:
                viewer.storage['bag 0'] = text
                viewer.until(lambda: viewer.text('overview'), update)
                before = places()
                viewer.until(lambda: places() != before, update)
                clock[0] += 2.0
                viewer.until(lambda: viewer.storage['bag 0'] != text, update)
                kept = viewer.storage['bag 0']
                assert 'NaN' not in kept
                assert 'Infinity' not in kept
                assert Settings().restore(kept) == ''

        shown.until(lambda: '/world/frames' in shown.viewer.nodes)
        check()
