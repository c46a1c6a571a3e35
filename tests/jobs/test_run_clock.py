"""How long a run will take: told from frames and stages that were done, and right to a third."""

from collections.abc import Iterator
from itertools import islice

import pytest

from savmap.jobs import run_clock
from savmap.jobs.run_clock import FrameCost, RunClock
from savmap.types.progress import Monitor, SilentMonitor

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


def run(
    clock: RunClock, machine: Machine, names: str, frames: int, shares: dict[str, float], looks: int = 0
) -> Iterator[None]:
    """All rows, one after the other, with a moment to look at the clock after each bit of work."""

    def begun(stage: str, name: str) -> Monitor:
        return clock.task((stage, (name,)), lambda: machine.processor)

    for name in names:
        monitor = begun("measured", name)
        machine.work(PLAN_S)
        for _ in monitor.each(range(frames), "measuring", frames):
            machine.work(FRAME_S)
            yield
        for look in range(looks + 1):
            for _ in range(10):
                machine.work(shares["measured"] * frames * FRAME_S / 10)
                yield
            if look < looks:
                for _ in monitor.each(range(frames), "looking again", frames):
                    machine.work(FRAME_S)
        clock.end("measured", name)
        for stage in ("solved", "pictured"):
            begun(stage, name)
            machine.work(shares[stage] * frames * FRAME_S)
            clock.end(stage, name)
            yield
    machine.work(len(names) * run_clock.DRAWN * frames * FRAME_S)


@pytest.mark.parametrize("names", ["A", "AB", "ABCDE"])
@pytest.mark.parametrize("factor", [0.85, 1.0, 1.2])
def test_the_rest_of_a_run_is_told_to_a_third(names: str, factor: float, machine: Machine) -> None:
    clock = RunClock(dict.fromkeys(names, (100, 1)), names, SilentMonitor(), pictures=True)
    assert clock.left_s(1) is None
    shares = {stage: factor * share for stage, share in run_clock.SHARES.items()}
    told = [(machine.now, clock.left_s(1)) for _ in run(clock, machine, names, 100, shares)]
    for share in (0.2, 0.4, 0.6, 0.8):
        now, left = min(told, key=lambda one: abs(one[0] - share * machine.now))
        assert left == pytest.approx(machine.now - now, rel=1 / 3)


def test_stages_that_were_seen_count_more_than_the_shares(machine: Machine) -> None:
    clock = RunClock(dict.fromkeys("ABC", (50, 1)), "ABC", SilentMonitor(), pictures=True)
    shares = {stage: 4 * share for stage, share in run_clock.SHARES.items()}
    told = [(machine.now, clock.left_s(1)) for _ in run(clock, machine, "ABC", 50, shares)]
    now, left = min(told, key=lambda one: abs(one[0] - 0.5 * machine.now))
    assert left == pytest.approx(machine.now - now, rel=0.1)


def test_rows_are_shared_among_workers(machine: Machine) -> None:
    clock = RunClock(dict.fromkeys("ABCD", (100, 1)), "ABCD", SilentMonitor(), pictures=False)
    monitor = clock.task(("measured", ("A",)), lambda: machine.processor)
    for _ in monitor.each(range(20), "measuring", 100):
        machine.work(FRAME_S)
    (one, two, four) = (clock.left_s(workers) for workers in (1, 2, 4))
    assert one is not None
    assert two is not None
    assert four is not None
    assert one > 1.6 * two > 2.4 * four
    for name in "BCD":
        clock.skip(name, "measured", "solved")
    alone = clock.left_s(4)
    assert alone is not None
    assert alone < four


def test_a_second_look_is_counted_while_it_is_taken(machine: Machine) -> None:
    clock = RunClock({"A": (100, 1)}, "A", SilentMonitor(), pictures=False)
    monitor = clock.task(("measured", ("A",)), lambda: machine.processor)
    for _ in monitor.each(range(100), "measuring", 100):
        machine.work(FRAME_S)
    before = clock.left_s(1)
    steps = monitor.each(range(100), "looking again", 100)
    next(steps)
    during = clock.left_s(1)
    assert before is not None
    assert during is not None
    assert (
        0.8 * 100 * FRAME_S < during - before + 0.5 * run_clock.SHARES["measured"] * 100 * FRAME_S < 1.1 * 100 * FRAME_S
    )


def test_work_for_one_core_takes_the_processor_s_time() -> None:
    assert FrameCost.of([(0.0, 0.0), (1.0, 1.5), (2.0, 3.0)]) == FrameCost(1.0, 1.5)
    assert FrameCost.of([(0.0, 0.0), (1.0, 0.6), (2.0, 1.2)]) == FrameCost(1.0, 1.0)


def test_rows_that_are_solved_together_take_one_worker(machine: Machine) -> None:
    clock = RunClock(dict.fromkeys("AB", (100, 1)), ["AB"], SilentMonitor(), pictures=False)
    for name in "AB":
        for _ in clock.task(("measured", (name,)), lambda: machine.processor).each(range(100), "measuring", 100):
            machine.work(FRAME_S)
        clock.end("measured", name)
    shares = run_clock.SHARES["solved"] + run_clock.DRAWN
    assert clock.left_s(2) == pytest.approx(200 * shares * FRAME_S, rel=0.05)


def test_frames_that_were_kept_tell_nothing_of_the_others(machine: Machine) -> None:
    clock = RunClock({"A": (100, 1)}, "A", SilentMonitor(), pictures=False)
    steps = clock.task(("measured", ("A",)), lambda: machine.processor).each(range(100), "measuring", 100)
    for number in islice(steps, 60):
        machine.work(FRAME_S if number >= 50 else FRAME_S / 20)
    left = clock.left_s(1)
    shares = sum(run_clock.SHARES[stage] for stage in ("measured", "solved")) + run_clock.DRAWN
    assert left == pytest.approx((40 + 100 * shares) * FRAME_S, rel=0.05)
