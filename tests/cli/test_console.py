"""What commands say of long work where nobody looks at a terminal."""

import io
import re
from pathlib import Path

import pytest
from rich.console import Console as Terminal

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


def test_a_line_every_half_minute(clock: list[float], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    long_work(tmp_path, clock, 100, "rendering panoramas", 12.0)
    assert capsys.readouterr().err.splitlines()[:2] == [
        "rendering panoramas: 3 of 100 (3%), about 19 min left",
        "rendering panoramas: 6 of 100 (6%), about 19 min left",
    ]
    with Console(tmp_path / "log") as shown:
        assert list(shown.each("abc", "short", 3)) == ["a", "b", "c"]
    assert capsys.readouterr().err == ""


def test_the_last_line_tells_seconds(clock: list[float], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    long_work(tmp_path, clock, 8, "rendering \x1b panoramas", 15.0)
    assert capsys.readouterr().err.splitlines() == [
        "rendering \\x1b panoramas: 2 of 8 (25%), about 90 s left",
        "rendering \\x1b panoramas: 4 of 8 (50%), about 60 s left",
        "rendering \\x1b panoramas: 6 of 8 (75%), about 30 s left",
        "reading: 5",
    ]


def rows_at_work(shown: Console, clock: list[float]) -> None:
    """Two rows in work, of which one is ahead, and how long the run will take."""
    run = shown.each(range(9), "rows mapped", 9)
    rows = [shown.each(range(100), f"row {name}, pass 1: measuring", 100) for name in "AB"]
    next(run)
    for number in range(4):
        for row in (rows[0], rows[0], rows[1]):
            next(row)
        clock[0] += 5.0 if number < 3 else 20.0
        shown.left(400.0 - clock[0])
    if shown.bars is not None:
        shown.bars.refresh()
    for one in (*rows, run):
        next(one)
        one.close()  # type: ignore[attr-defined]


def test_rows_are_told_by_name_with_the_run_s_time(
    clock: list[float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Console(tmp_path / "log") as shown:
        rows_at_work(shown, clock)
    assert capsys.readouterr().err.splitlines() == [
        "rows mapped: 0 of 9 (0%), about 6 min left",
        "row A, pass 1: measuring: 8 of 100 (8%)",
        "row B, pass 1: measuring: 4 of 100 (4%)",
    ]


def test_a_terminal_shows_all_rows_at_once(clock: list[float], tmp_path: Path) -> None:
    screen = io.StringIO()
    with Console(tmp_path / "log") as shown:
        shown.terminal = Terminal(file=screen, force_terminal=True, width=120)
        rows_at_work(shown, clock)
        assert shown.bars is None
        shown.note("done")
    drawn = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.getvalue())
    for text in ("rows mapped", "about 6 min left", "row A, pass 1: measuring", "row B, pass 1: measuring", "done"):
        assert text in drawn
