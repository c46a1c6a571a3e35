"""Frames that are missing are named, with where, when the references contradict the video."""

from dataclasses import replace

import made_up_rack as made
import numpy as np
import pytest

from savmap.graph.initial.gaps import where_frames_are_missing, where_tracks_miss_frames
from savmap.graph.initial.outlier_references import contradiction
from savmap.types import Bools, FrameTable, Track


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
    assert where_tracks_miss_frames(world.tracks, world.facts.frames) == text


@pytest.mark.parametrize(("shared", "told"), [(2, "hardly anything"), (0, "nothing")])
def test_a_cut_after_which_other_things_are_seen_is_named(whole: made.World, shared: int, told: str) -> None:
    """Where tracks do not go on across the cut, how far things moved cannot tell."""
    after = 30
    halves = [
        part
        for track in whole.tracks
        for part in (_piece(track, track.frames < after), _piece(track, track.frames >= after))
    ]
    joined = [
        replace(part, name=f"{part.name}, later") if part.frames[0] >= after else part
        for part in halves
        if len(part.frames)
    ]
    seen = {part.name for part in joined if after - 1 in part.frames}
    kept = [
        part
        for part in joined
        if part.name.endswith(", later") and after in part.frames and part.name.removesuffix(", later") in seen
    ]
    common = {part.name: part.name.removesuffix(", later") for part in kept[:shared]}
    tracks = [replace(part, name=common.get(part.name, part.name)) for part in joined]
    text = where_tracks_miss_frames(tracks, whole.facts.frames)
    assert text.startswith("frames seem to be missing between frames 29 and 30 of one")
    assert text.endswith(f"{told} is seen in both: see whether the video was cut there")


def _piece(track: Track, rows: Bools) -> Track:
    """What was seen in some of a track's frames."""
    views = tuple(view for view, kept in zip(track.views, rows.tolist(), strict=True) if kept)
    return replace(
        track, frames=track.frames[rows], views=views, pixels=track.pixels[rows], covariances=track.covariances[rows]
    )
