"""What commands say of long work where nobody looks at a terminal."""

from pathlib import Path

import pytest

from savmap.cli import console
from savmap.cli.console import Console


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Seconds that the console believes in."""
    now = [0.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    return now


def long_work(folder: Path, clock: list[float], count: int, doing: str, each_s: float) -> None:
    """So many steps, whose number the console knows, then six of which it does not."""
    with Console(folder / "log") as shown:
        for _ in shown.each(range(count), doing, count):
            clock[0] += each_s
        for _ in shown.each(iter("abcdef"), "reading"):
            clock[0] += 6.0


def test_a_line_every_ten_seconds(clock: list[float], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    long_work(tmp_path, clock, 100, "rendering panoramas", 4.0)
    assert capsys.readouterr().err.splitlines()[:2] == [
        "rendering panoramas: 3 of 100 (3%), about 6 min left",
        "rendering panoramas: 6 of 100 (6%), about 6 min left",
    ]
    with Console(tmp_path / "log") as shown:
        assert list(shown.each("abc", "short", 3)) == ["a", "b", "c"]
    assert capsys.readouterr().err == ""


def test_the_last_line_tells_seconds(clock: list[float], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    long_work(tmp_path, clock, 8, "rendering \x1b panoramas", 5.0)
    assert capsys.readouterr().err.splitlines() == [
        "rendering \\x1b panoramas: 2 of 8 (25%), about 30 s left",
        "rendering \\x1b panoramas: 4 of 8 (50%), about 20 s left",
        "rendering \\x1b panoramas: 6 of 8 (75%), about 10 s left",
        "reading: 2",
        "reading: 4",
    ]
