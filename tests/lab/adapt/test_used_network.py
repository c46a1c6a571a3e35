"""Which network a site teaches: the one that looks at most of its rows."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from savmap.errors import VideoError
from savmap.lab.adapt import run
from savmap.types.progress import NoteCollector

OWN, OTHER = Path("own.int8.onnx"), Path("other.int8.onnx")


def chosen(monkeypatch: pytest.MonkeyPatch, best: dict[str, Path | None]) -> tuple[Path, list[str]]:
    """The network to be taught, and the notes, where these networks are the best in rows (None: footage that cannot be read)."""

    def best_for(footage: str, plugin: object, renderer: object) -> SimpleNamespace:
        model = best[footage]
        if model is None:
            raise VideoError("no such video")
        return SimpleNamespace(model=model)

    monkeypatch.setattr(run, "best_for_pass", best_for)
    rows = {name: SimpleNamespace(passes=[name]) for name in best}
    job = SimpleNamespace(site=SimpleNamespace(rows=rows), opened=lambda row, name: SimpleNamespace(model=OWN))
    notes = NoteCollector()
    return run.used_network(cast(Any, job), "posts", notes), notes.lines


@pytest.mark.parametrize(
    ("best", "expected"),
    [
        ({"A": OWN}, OWN),
        ({"A": OTHER, "B": OTHER, "C": OWN}, OTHER),
        ({"A": OTHER, "B": OWN}, OWN),
        ({"A": None, "B": OTHER}, OTHER),
        ({"A": None}, OWN),
    ],
)
def test_most_rows_decide(monkeypatch: pytest.MonkeyPatch, best: dict[str, Path | None], expected: Path) -> None:
    model, notes = chosen(monkeypatch, best)
    assert model == expected
    assert bool(notes) is (expected == OTHER)


def test_a_few_rows_of_a_large_site_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    best: dict[str, Path | None] = {f"{number}": OWN for number in range(31)}
    best |= dict.fromkeys(("0", "6", "12", "18", "24", "30"), OTHER)
    assert chosen(monkeypatch, best)[0] == OTHER
