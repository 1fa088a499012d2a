"""The page of web_view in a real browser, when pages and servers come and go."""

import signal

from endings import without_library_lines
from processes import ARM, tool

VIEW = tool('web_view')
#: Frames whose names do not cover each other for long, whatever the arm does.
FRAMES = 'map, base_link', 'joint_1', 'end_effector'


def test_several_viewers_on_the_next_free_port(start, browse):
    """Closing or reloading one of two pages, or ending one of two servers, harms no other."""
    start(*ARM)
    views = [start(*VIEW), start(*VIEW)]
    urls = [view.url() for view in views]
    assert urls[0] != urls[1]
    first, second = browse(urls[0]), browse(urls[0])
    first.scene_with(*FRAMES)
    first.page.close()
    second.scene_with(*FRAMES)
    second.page.reload()
    second.scene_with(*FRAMES)
    for view, signal_number in zip(views, (signal.SIGINT, signal.SIGTERM)):
        view.end(signal_number)
        assert view.exit_code() == 0
        assert without_library_lines(view.output) == f'look at {urls[views.index(view)]}\n'
    second.faults.clear()  # the page cannot connect any more
