"""Which hook is at work is reported to a sink, begin and end, whatever happens in it."""

from collections.abc import Iterator

import pytest

from savmap.errors import PluginFailedError
from savmap.plugin import activity

from .made_up_plugin import VIEW, loaded

Calls = list[tuple[str, str]]


@pytest.fixture
def calls() -> Iterator[Calls]:
    reported: Calls = []
    activity.set_sink(lambda plugin, hook: reported.append((plugin, hook)))
    yield reported
    activity.set_sink(None)


def test_a_hook_is_reported_when_it_begins_and_ends(calls: Calls) -> None:
    loaded(extract_features=lambda self: []).extract_features(VIEW, [])
    assert calls == [("made-up", "extract_features"), ("", "")]


def test_a_hook_that_raises_has_ended_too(calls: Calls) -> None:
    with pytest.raises(PluginFailedError):
        loaded(extract_features=lambda self: 1 / 0).extract_features(VIEW, [])
    assert calls[-1] == ("", "")


def test_the_outer_hook_is_at_work_again_after_an_inner_one(calls: Calls) -> None:
    with activity.at_work("outer", "render_views"), activity.at_work("outer", "detect"):
        pass
    assert calls == [("outer", "render_views"), ("outer", "detect"), ("outer", "render_views"), ("", "")]


def test_without_a_sink_nothing_is_reported() -> None:
    assert loaded(extract_features=lambda self: []).extract_features(VIEW, []) == []
