"""Frames that are missing are named, with where, when the references contradict the video."""

from dataclasses import replace

import made_up_rack as made
import numpy as np
import pytest

from savmap.graph.initial.gaps import where_frames_are_missing
from savmap.graph.initial.outlier_references import contradiction
from savmap.types import FrameTable


@pytest.fixture(scope="module")
def whole() -> made.World:
    return made.world(3, sections=3, frames=60, bridge=None)


def cut(world: made.World, missing: range, closed: bool) -> made.World:
    """The world without some frames; `closed`: those after them are numbered and stamped as if there was no gap."""
    bare = made.without_frames(world, set(missing))
    if not closed:
        return bare
    tracks = [
        replace(t, frames=np.where(t.frames >= missing.stop, t.frames - len(missing), t.frames)) for t in bare.tracks
    ]
    frames = len(world.poses) - len(missing)
    facts = replace(world.facts, frames=FrameTable(np.arange(frames) / 7.0, ("one",) * frames))
    kept = [number for number in range(len(world.poses)) if number not in missing]
    return replace(bare, tracks=tracks, facts=facts, poses=world.poses[kept])


def test_nothing_is_missing_from_a_whole_pass(whole: made.World) -> None:
    assert where_frames_are_missing(made.problem(whole, made.begin(whole))) == ""


def test_a_gap_in_time_is_named(whole: made.World) -> None:
    problem = made.problem(world := cut(whole, range(30, 40), closed=False), made.begin(world))
    assert "1.6 s of frames are missing between frames 29 and 40 of one (at 4.1 s" in where_frames_are_missing(problem)


def test_a_cut_without_a_gap_in_time_is_named(whole: made.World) -> None:
    problem = made.problem(world := cut(whole, range(30, 40), closed=True), made.begin(world))
    text = where_frames_are_missing(problem)
    assert "between frames 29 and 30 of one" in text
    assert text in str(contradiction(problem, "a length is wrong"))
