"""Fixtures: what writes bags, a clock, a page of web_view with a viewer, a working directory."""

from contextlib import ExitStack

import pytest


@pytest.fixture
def bags():
    """The helpers that write bags."""
    return pytest.importorskip('bags')


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test sets, also of bags that are played: `clock[0]` (s)."""
    now = [1000.0]
    monkeypatch.setattr('puretf_tools.view.feed.monotonic', lambda: now[0])
    return now


@pytest.fixture
def page(clock):
    """A function that creates the page of a feed or a buffer, and a viewer of it."""
    pytest.importorskip('viser')
    from viewer import Page, StubFeed

    from puretf_tools.view.feed import Feed
    with ExitStack() as stack:
        yield lambda shown, **options: Page(
            shown if isinstance(shown, Feed) else StubFeed(shown), clock, stack, **options)


@pytest.fixture
def there(monkeypatch, tmp_path):
    """The working directory, which is empty."""
    path = tmp_path / 'there'
    path.mkdir()
    monkeypatch.chdir(path)
    return path
