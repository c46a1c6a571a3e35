"""What a plugin says counts for what it sees is in the fingerprint."""

import pytest
from pydantic import BaseModel, ConfigDict

from savmap.jobs import cache_keys
from savmap.plugin.manager import loaded_plugin


class Config(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Reader:
    name = "reader"
    classes = ("plate",)
    libraries = ("a-reading-library",)

    def __init__(self, config: Config) -> None: ...


def test_a_library_that_a_plugin_names_counts_once_it_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    room = loaded_plugin("reader", Reader, Config())
    without = cache_keys.code([room])
    installed = cache_keys.version
    monkeypatch.setattr(cache_keys, "version", lambda name: "1.0" if name == "a-reading-library" else installed(name))
    assert cache_keys.code([room]) != without
