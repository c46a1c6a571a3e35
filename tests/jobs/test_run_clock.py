"""How long a run will take: told from frames and stages that were done, and right to a third."""

from collections.abc import Iterator
from itertools import islice

import pytest

from savmap.jobs import run_clock
from savmap.jobs.run_clock import FrameCost, RunClock, Walk
from savmap.types.progress import SilentMonitor

FRAME_S, PLAN_S = 0.5, 14.0


class Machine:
    """A clock that goes on as work is done: seconds on the clock, and of the processor."""

    def __init__(self) -> None:
        self.now = self.processor = 0.0

    def work(self, seconds: float, processor: float | None = None) -> None:
        self.now += seconds
        self.processor += seconds if processor is None else processor


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    made = Machine()
    monkeypatch.setattr(run_clock.time, "monotonic", lambda: made.now)
    return made


def walks(names: str, frames: int) -> dict[tuple[str, ...], Walk]:
    return {(name,): Walk(frames, 1) for name in names}


def run(clock: RunClock, machine: Machine, names: str, frames: int, share: float) -> Iterator[None]:
    """All rows, one after the other, with a moment to look at the clock after each bit of work."""
    for name in names:
        monitor = clock.task((name,), lambda: machine.processor)
        machine.work(PLAN_S)
        for _ in monitor.each(range(frames), "measuring", frames):
            machine.work(FRAME_S)
            yield
        for _ in range(20):
            machine.work(share * frames * FRAME_S / 20)
            yield
        clock.end((name,))
        yield
    machine.work(len(names) * run_clock.DRAWN * frames * FRAME_S)


@pytest.mark.parametrize("names", ["A", "AB", "ABCDE"])
@pytest.mark.parametrize("factor", [0.9, 1.0, 1.1])
def test_the_rest_of_a_run_is_told_to_a_third(names: str, factor: float, machine: Machine) -> None:
    clock = RunClock(walks(names, 100), SilentMonitor(), pictures=True)
    assert clock.left_s(1) is None
    share = factor * sum(run_clock.SHARES.values())
    told = [(machine.now, clock.left_s(1)) for _ in run(clock, machine, names, 100, share)]
    for moment in (0.3, 0.4, 0.6, 0.8):
        now, left = min(told, key=lambda one: abs(one[0] - moment * machine.now))
        assert left == pytest.approx(machine.now - now, rel=1 / 3)


def test_rows_that_were_seen_count_more_than_the_shares(machine: Machine) -> None:
    clock = RunClock(walks("ABC", 50), SilentMonitor(), pictures=True)
    share = 4 * sum(run_clock.SHARES.values())
    told = [(machine.now, clock.left_s(1)) for _ in run(clock, machine, "ABC", 50, share)]
    now, left = min(told, key=lambda one: abs(one[0] - 0.5 * machine.now))
    assert left == pytest.approx(machine.now - now, rel=0.1)


def test_rows_are_shared_among_workers(machine: Machine) -> None:
    clock = RunClock(walks("ABCD", 100), SilentMonitor(), pictures=False)
    monitor = clock.task(("A",), lambda: machine.processor)
    for _ in monitor.each(range(20), "measuring", 100):
        machine.work(FRAME_S)
    (one, two, four) = (clock.left_s(workers) for workers in (1, 2, 4))
    assert one is not None
    assert two is not None
    assert four is not None
    assert one > 1.5 * two > 2.2 * four
    for name in "BCD":
        clock.end((name,))
    alone = clock.left_s(4)
    assert alone is not None
    assert alone < four


def test_work_for_one_core_takes_the_processor_s_time() -> None:
    assert FrameCost.of([(0.0, 0.0), (1.0, 1.5), (2.0, 3.0)]) == FrameCost(1.0, 1.5)
    assert FrameCost.of([(0.0, 0.0), (1.0, 0.6), (2.0, 1.2)]) == FrameCost(1.0, 1.0)


def test_frames_that_were_kept_tell_nothing_of_the_others(machine: Machine) -> None:
    clock = RunClock(walks("A", 100), SilentMonitor(), pictures=False)
    steps = clock.task(("A",), lambda: machine.processor).each(range(100), "measuring", 100)
    for number in islice(steps, 60):
        machine.work(FRAME_S if number >= 50 else FRAME_S / 20)
    left = clock.left_s(1)
    shares = sum(run_clock.SHARES[stage] for stage in ("measured", "solved")) + run_clock.DRAWN
    assert left == pytest.approx((40 + 100 * shares) * FRAME_S, rel=0.05)
