"""Whatever a result depends on is in its key: libraries that a plugin names, a network's weights, a package's files."""

from pathlib import Path

import pytest

from savmap.jobs import cache_keys
from savmap.jobs.map_site import made_by
from savmap.site.job import job_for
from savmap.site.overrides import overrides_of

from ..plugin.made_up_plugin import loaded
from ..vision.weights import retrain, with_weights_beside

EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev"


def test_a_library_that_a_plugin_names_counts_once_it_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    room = loaded(libraries=("a-reading-library",))
    without = cache_keys.code([room])
    installed = cache_keys.version
    monkeypatch.setattr(cache_keys, "version", lambda name: "1.0" if name == "a-reading-library" else installed(name))
    assert cache_keys.code([room]) != without


def test_a_row_is_measured_again_with_other_weights(tmp_path: Path) -> None:
    """Which lie in a file beside the network's own."""
    model = with_weights_beside(tmp_path / "net.onnx", "net.onnx.data")

    def made_of() -> tuple[str, str]:
        job = job_for(
            EXAMPLE / "site.yaml", None, tmp_path, overrides=overrides_of([f"plugins.lights.model={model}"], {})
        )
        return cache_keys.measurement_key(job, "A"), made_by(job)["model lights"]

    before = made_of()
    assert made_of() == before
    retrain(tmp_path / "net.onnx.data")
    assert not set(made_of()) & set(before)


def test_what_lies_beside_a_plugins_code_counts(tmp_path: Path) -> None:
    (tmp_path / "plugin.py").write_text("A = 1", encoding="utf-8")
    before = cache_keys._sources(tmp_path)
    (tmp_path / "fitted.json").write_text("{}", encoding="utf-8")
    cache_keys._sources.cache_clear()
    assert cache_keys._sources(tmp_path) != before
