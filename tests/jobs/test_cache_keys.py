"""What a plugin says counts for what it sees is in the fingerprint."""

import pytest

from savmap.jobs import cache_keys

from ..plugin.made_up_plugin import loaded


def test_a_library_that_a_plugin_names_counts_once_it_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    room = loaded(libraries=("a-reading-library",))
    without = cache_keys.code([room])
    installed = cache_keys.version
    monkeypatch.setattr(cache_keys, "version", lambda name: "1.0" if name == "a-reading-library" else installed(name))
    assert cache_keys.code([room]) != without
