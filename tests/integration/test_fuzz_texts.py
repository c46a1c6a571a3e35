"""Broken texts of every kind end in one line or are used. `bench/fuzz_texts.py` does the same with ten thousand."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings

BENCH = Path(__file__).parents[2] / "bench"
sys.path.insert(0, str(BENCH))

import fuzz_mutations  # noqa: E402
import fuzz_texts  # noqa: E402
import fuzz_uses  # noqa: E402

KINDS = fuzz_uses.kinds()
EACH = [pytest.param(kind, marks=[pytest.mark.extra("cad")] if kind == "drawing" else []) for kind in KINDS]


@pytest.fixture(scope="module")
def numbers() -> Iterator[int]:
    return iter(range(10**6))


@pytest.mark.parametrize("kind", EACH)
def test_sound_texts_are_used(tmp_path: Path, kind: str) -> None:
    own = KINDS[kind]
    (tmp_path / own.name).write_bytes(own.written(own.seed))
    outcome = fuzz_texts.tried(kind, tmp_path / own.name, 0)
    assert (outcome.ending, outcome.line) == ("used", "")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", EACH)
def test_broken_texts_are_refused_in_a_line_or_used(
    tmp_path_factory: pytest.TempPathFactory, numbers: Iterator[int], kind: str
) -> None:
    own = KINDS[kind]

    @settings(max_examples=40, database=None, deadline=None, derandomize=True, phases=[Phase.generate], suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(fuzz_mutations.texts(own.seed, own.written))
    def each(content: bytes) -> None:
        path = tmp_path_factory.mktemp(f"{next(numbers)}") / own.name
        path.write_bytes(content)
        outcome = fuzz_texts.tried(kind, path, 0)
        assert outcome.ending in ("refused", "used"), outcome.line
        assert outcome.seconds < 10

    each()
