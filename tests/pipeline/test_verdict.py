"""The verdict: which structures too few frames support, which odd and even frames disagree about, and what plugins doubt."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.errors import DoubtfulError
from savmap.graph import Landmark, References, camera_priors, solve_rows
from savmap.graph.solver.residuals import DirectionalErrors
from savmap.graph.solver.solution import LensDistanceError, VerticalScaleError
from savmap.jobs.map_site import SiteRun
from savmap.maps.run_record import RunLog
from savmap.pipeline.records import DescribedRow, LocatedRow, PosedRow, RowMeasurements, RowRequest, SolvedRow
from savmap.pipeline.row import collect, constrain, track
from savmap.pipeline.trust.ends import without_beyond
from savmap.pipeline.trust.support import Support, supports
from savmap.pipeline.trust.verdict import judge
from savmap.plugin.hookspecs import hookimpl
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.types import Doubt, Feature, RowMap, SiteMap, Structure, Track, Verdict
from savmap.types.progress import SilentMonitor
from savmap.vision.markers import MarkerTracks

from ..graph import made_up_wall as made

FACTS, VIEW = made.FACTS, made.VIEW


def post(number: int) -> Structure:
    return Structure(
        f"post {number}", "post", made.WALL[number][None], 1e-6 * np.eye(3)[None], ("foot",), np.zeros((0, 2), np.int64)
    )


LENGTH = made.KnownLength("post 0", "post 12", 4.0, 0.001, axis="x")


class Wall(made.Wall):
    """Of which every post is a structure."""

    @hookimpl
    def describe(self) -> list[Structure]:
        return [post(number) for number in range(len(made.WALL))]


def mapped(wall: type[Wall]) -> DescribedRow:
    """The wall's row, described, with the known length between two posts as its scale."""
    plugin: LoadedPlugin = loaded_plugin("wall", wall, made.Config())
    references = References((made.CAMERA_HEIGHT,), (LENGTH,))
    measured = RowMeasurements(FACTS, {"wall": []}, {}, frozenset({"wall"}), (), MarkerTracks({}, {}))
    start = made.path()
    row = LocatedRow(
        RowRequest("A", (), [plugin], references), measured, start, camera_priors(FACTS, start, references)
    )
    posed: PosedRow = constrain(track(row, SilentMonitor()), SilentMonitor())
    (solution,) = solve_rows([posed.problem], [[("one", stamp) for stamp in FACTS.frames.stamps_s.tolist()]])
    assert not isinstance(solution, Exception)
    solved = SolvedRow(**vars(posed), solution=solution)
    return DescribedRow(**vars(solved), structures={"wall": tuple(plugin.describe([], FACTS, solution))}, face=None)


def test_a_map_that_repeats_is_trusted() -> None:
    row = mapped(Wall)
    assert len(row.solution.halves) == len(made.WALL)
    structures, verdict = judge(row)
    assert verdict.grade == "trusted"
    [note] = verdict.notes
    assert note.startswith(f"nothing checks camera height and length {LENGTH.start} to {LENGTH.end}, which give scale")
    assert {own.attributes["support"] for own in structures["wall"]} == {1.0}


@pytest.mark.parametrize(
    ("off", "doubts", "notes"),
    [
        ({"wall": (0.05, 0.2), "lamps": (0.1, 0.3)}, 1, 0),
        ({"wall": (0.05, 0.2), "lamps": (0.1, 0.05)}, 0, 1),
        ({"wall": (0.01, 0.2), "lamps": (0.1, 0.3)}, 0, 0),
    ],
)
def test_pictures_that_are_no_panoramas(off: dict[str, tuple[float, float]], doubts: int, notes: int) -> None:
    """What locates the camera may look different from aslant; something else that is off in the same way does not by chance."""
    row = mapped(Wall)
    directional = {plugin: DirectionalErrors(*values) for plugin, values in off.items()}
    _, verdict = judge(replace(row, solution=replace(row.solution, directional=directional)))
    assert [doubt.kind for doubt in verdict.doubts] == doubts * ["camera"]
    assert sum("no true panoramas" in note for note in verdict.notes) == notes


@pytest.mark.parametrize(
    ("share", "sigma", "doubted"),
    [(0.01, 0.001, "1.00 ± 0.10 % too large"), (-0.01, 0.001, "too small"), (0.01, 0.003, ""), (0.0015, 0.0001, "")],
)
def test_stretched_pictures(share: float, sigma: float, doubted: str) -> None:
    row = mapped(Wall)
    off = {plugin: DirectionalErrors(0.05, 0.2) for plugin in ("wall", "lamps")} if doubted else {}
    solution = replace(row.solution, vertical_scale=VerticalScaleError(share, sigma), directional=off)
    _, verdict = judge(replace(row, solution=solution))
    assert [doubt.kind for doubt in verdict.doubts] == (["camera"] if doubted else [])
    assert all(doubted in doubt.figure and "vertical_scale: true" in doubt.action for doubt in verdict.doubts)


@pytest.mark.parametrize(
    ("displacement", "deviation", "doubted"),
    [(0.015, 5.0, "lenses 3.0 ± 0.5 cm apart"), (0.015, 3.0, ""), (0.001, 5.0, "")],
)
def test_pictures_bent_at_the_seam(displacement: float, deviation: float, doubted: str) -> None:
    row = mapped(Wall)
    solution = replace(row.solution, lens_distance=LensDistanceError(0.03, 0.005, displacement, deviation))
    _, verdict = judge(replace(row, solution=solution))
    assert [doubt.kind for doubt in verdict.doubts] == (["camera"] if doubted else [])
    assert all(doubted in doubt.figure and "lens_distance: true" in doubt.action for doubt in verdict.doubts)


def test_what_is_said_twice_is_told_once() -> None:
    row = mapped(Wall)
    doubt = Doubt("support", "all frames show something that is not mapped", action="look: post 7")
    measurements = replace(row.measurements, doubts=(doubt, doubt))
    _, verdict = judge(replace(row, measurements=measurements, notes=("one pass", "one pass")))
    assert verdict.doubts == (doubt,)
    assert verdict.notes.count("one pass") == 1


class Shaky(Wall):
    """Odd frames see post 7 a little lower than even ones."""

    def tracks(self) -> list[Track]:
        found = super().tracks()
        moved = found[7].pixels + np.where(found[7].frames % 2 == 1, 0.24, -0.24)[:, None] * [0, 1]
        return [*found[:7], replace(found[7], pixels=moved), *found[8:]]


def test_halves_see_what_differs_between_odd_and_even_frames() -> None:
    apart = {half.name: np.abs(half.difference) for half in mapped(Shaky).solution.halves}
    assert apart["post 7"][1] == pytest.approx(2 * 0.24 / made.SPEC.camera[1, 1] * 2.5, rel=0.3)
    assert max(np.max(other) for name, other in apart.items() if name != "post 7") < 0.5 * apart["post 7"][1]


@pytest.mark.parametrize(("apart_m", "doubted"), [(0.03, True), (0.004, False)])
def test_frames_that_disagree_about_a_structure_are_doubted(apart_m: float, doubted: bool) -> None:
    row = mapped(Wall)
    halves = [
        replace(half, difference=half.difference + apart_m * np.eye(3)[0] * (half.name == "post 7"))
        for half in row.solution.halves
    ]
    _, verdict = judge(replace(row, solution=replace(row.solution, halves=tuple(halves))))
    if not doubted:
        assert verdict.doubts == ()
        return
    (doubt,) = verdict.doubts
    assert (doubt.kind, doubt.structures) == ("repeatability", ("post 7",))
    assert (
        doubt.line == "odd and even frames put an element apart: 2.8 cm apart; look whether it is one element: post 7"
    )
    assert doubt.details == ("post 7 along x",)
    assert doubt.place == pytest.approx(made.WALL[7])


def test_a_structure_whose_measurements_do_not_fit_is_doubted() -> None:
    class Mistaken(Wall):
        """Half of the frames take something else for post 7, far from it."""

        def tracks(self) -> list[Track]:
            found = super().tracks()
            moved = found[7].pixels + np.where(found[7].frames % 2 == 1, 30.0, 0.0)[:, None]
            return [*found[:7], replace(found[7], pixels=moved), *found[8:]]

    _, verdict = judge(mapped(Mistaken))
    assert [(doubt.kind, doubt.structures) for doubt in verdict.doubts] == [("residuals", ("post 7",))]
    assert verdict.doubts[0].line.startswith("measurements of an element do not fit it: ")


def offset(*metres: float, used: int) -> Landmark:
    """A landmark whose measurements are so far off, the first of which were used."""
    return Landmark(made.WALL[7], 1e-6 * np.eye(3), used, len(metres) - used, np.array(metres))


@pytest.mark.parametrize(
    ("landmark", "told"),
    [
        (offset(0.001, 0.001, 0.001, 0.03, 0.04, 0.04, used=3), "3 of 6 rejected"),
        (offset(0.001, 0.001, 0.001, 0.004, 0.005, 0.006, used=3), ""),
        (offset(0.01, 0.02, 0.03, 0.03, 0.04, 0.05, used=6), "half over 3.0 cm off"),
        (offset(0.01, 0.01, 0.015, 0.015, 0.02, 0.02, used=6), ""),
    ],
    ids=["rejected, far off", "rejected, but near", "of no one thing", "scattered, but near"],
)  # fmt: skip
def test_measurements_that_are_far_off_speak_against_a_structure(landmark: Landmark, told: str) -> None:
    row = mapped(Wall)
    landmarks = {"wall": {**row.solution.landmarks["wall"], "post 7": landmark}}
    _, verdict = judge(replace(row, solution=replace(row.solution, landmarks=landmarks)))
    assert [doubt.figure for doubt in verdict.doubts] == ([told] if told else [])


def test_offsets_are_metres_at_the_landmark() -> None:
    class Shifted(Wall):
        """One frame sees post 7 a pixel lower."""

        def tracks(self) -> list[Track]:
            found = super().tracks()
            moved = found[7].pixels + (np.arange(len(found[7].pixels)) == 9)[:, None] * [0.0, 3.0]
            return [*found[:7], replace(found[7], pixels=moved), *found[8:]]

    off = mapped(Shifted).solution.landmarks["wall"]["post 7"].offsets
    assert len(off) == made.FRAMES
    assert off.max() == pytest.approx(3.0 / made.SPEC.camera[1, 1] * 2.5, rel=0.35)
    assert np.median(off) < 0.1 * off.max()


def test_a_minor_doubt_is_a_note() -> None:
    class Odd(Wall):
        @hookimpl
        def doubt(self) -> list[Doubt]:
            return [Doubt("shape", "the top of post 1 is hidden", ("post 1",), minor=True)]

    _, verdict = judge(mapped(Odd))
    assert verdict.grade == "trusted"
    assert "the top of post 1 is hidden" in verdict.notes


def test_a_structure_that_few_frames_measured_is_doubted() -> None:
    class Seldom(Wall):
        """Post 4 is measured in two frames only."""

        def tracks(self) -> list[Track]:
            found = super().tracks()
            rare = found[4]
            few = replace(
                rare,
                frames=rare.frames[:1],
                views=rare.views[:1],
                pixels=rare.pixels[:1],
                covariances=rare.covariances[:1],
            )
            return [*found[:4], few, *found[5:]]

    structures, verdict = judge(mapped(Seldom))
    assert structures["wall"][4].attributes["support"] < 0.2
    assert [(doubt.kind, doubt.structures) for doubt in verdict.doubts] == [("support", ("post 4",))]
    assert verdict.grade == "check"


@pytest.mark.parametrize(("frames", "doubted"), [(1.0, True), (0.3, False)])
def test_what_was_seen_in_most_frames_and_not_mapped_is_doubted(frames: float, doubted: bool) -> None:
    row = mapped(Wall)
    pixel, covariance = np.zeros((1, 2)), np.eye(2)[None]
    seen = [
        Feature(frame, made.VIEW, "lamp", "centre", 1, pixel, covariance) for frame in range(int(frames * made.FRAMES))
    ]
    lamps: LoadedPlugin = loaded_plugin("lamps", made.Wall, made.Config())
    request = replace(row.request, plugins=[*row.request.plugins, lamps])
    measurements = replace(row.measurements, features={**row.measurements.features, "lamps": seen})
    row = replace(row, request=request, measurements=measurements, structures={**row.structures, "lamps": ()})
    _, verdict = judge(row)
    what, figure = "nothing is mapped of what frames show", f"{len(seen)} of {made.FRAMES} frames"
    told = f"{what}: {figure}; look whether all of it is missing: lamps"
    assert [doubt.line for doubt in verdict.doubts] == [told] * doubted


def test_what_a_plugin_the_footage_and_the_solve_doubt_is_kept() -> None:
    shape, motion = Doubt("shape", "post 1 is odd", ("post 1",)), Doubt("motion", "the camera turns round at 3.0 s")

    class Odd(Wall):
        @hookimpl
        def doubt(self) -> list[Doubt]:
            return [shape]

    row = mapped(Odd)
    row = replace(row, measurements=replace(row.measurements, doubts=(motion,)))
    reference = Doubt("reference", "the length is contradicted")
    row = replace(row, solution=replace(row.solution, doubts=(reference,)))
    assert collect(row).verdict == Verdict((motion, reference, shape), row.solution.unchecked)


def lamp(number: int, *x: float) -> Structure:
    vertices = np.array([[along, 5.0, 1.0] for along in x])
    covariances = np.tile(1e-6 * np.eye(3), (len(x), 1, 1))
    return Structure(f"lamp {number}", "lamp", vertices, covariances, tuple("ab"[: len(x)]), np.zeros((0, 2), np.int64))


def test_what_is_doubted_beyond_the_ends_is_a_note() -> None:
    ends = made.WALL[:, 0].min(), made.WALL[:, 0].max()
    over, partly = lamp(1, float(np.mean(ends))), lamp(2, ends[1] - 0.1, ends[1] + 0.9)
    beyond, before = lamp(3, ends[1] + 0.1, ends[1] + 1.1), lamp(4, ends[0] - 1.0)
    doubts = {one.id: Doubt("shape", f"{one.id} is odd", (one.id,)) for one in (over, partly, beyond, before)}
    both, whole = Doubt("shape", "a gap", (partly.id, beyond.id)), Doubt("motion", "the camera turns round")
    structures = {"wall": [post(n) for n in range(len(made.WALL))], "lamps": [over, partly, beyond, before]}
    kept, notes = without_beyond([*doubts.values(), both, whole], structures, frozenset({"wall"}))
    assert kept == [doubts["lamp 1"], doubts["lamp 2"], both, whole]
    assert notes == ["beyond the row's ends: lamp 3 is odd", "beyond the row's ends: lamp 4 is odd"]
    assert without_beyond([both], structures, frozenset()) == ([both], [])


def test_a_place_beyond_the_ends_where_something_may_be_missing_is_no_doubt() -> None:
    structures = {"wall": [post(n) for n in range(len(made.WALL))]}
    within, past = (Doubt("shape", "a lamp may be missing", (), (x, 3.0, 1.0)) for x in (2.0, 40.0))
    given = Doubt("reference", "the mark contradicts the rest", (), (40.0, 0.0, 0.0))
    kept, notes = without_beyond([within, past, given], structures, frozenset({"wall"}))
    assert kept == [within, given]
    assert notes == ["beyond the row's ends: a lamp may be missing"]
    assert without_beyond([past], structures, frozenset()) == ([past], [])


def test_support_counts_only_frames_that_should_show_it() -> None:
    path = made.path()
    # Of two frames the further one is beyond the usual reach.
    near = Track("post 1", "post", {}, np.arange(2), (VIEW,) * 2, np.zeros((2, 2)), np.tile(np.eye(2), (2, 1, 1)))
    found = supports([post(1), post(13)], [near], path, FACTS)
    assert found["post 1"].expected == found["post 1"].seen == 1
    assert found["post 13"].seen == 0
    behind = replace(FACTS, views={VIEW: replace(made.SPEC, yaw_deg=180.0)})
    assert supports([post(1)], [near], path, behind)["post 1"] == Support(0, 0)
    assert Support(0, 0).share == 1.0


def test_a_doubtful_map_ends_with_its_own_exit_code(tmp_path: object) -> None:
    row = collect(mapped(Wall))
    doubtful: RowMap = replace(row, verdict=Verdict((Doubt("shape", "post 1 is odd"),)))
    run = SiteRun(SiteMap({"A": doubtful}, {}), None, RunLog(rows={}), {}, frozenset())
    with pytest.raises(
        DoubtfulError, match="mapped, but 1 of 1 row must be checked: A; the reasons are above"
    ) as caught:
        run.raise_if_incomplete(made_job())
    assert caught.value.exit_code == 12
    replace(run, site_map=SiteMap({"A": row}, {})).raise_if_incomplete(made_job())


def made_job() -> object:
    from pathlib import Path
    from types import SimpleNamespace

    return SimpleNamespace(output=Path("out"), site=SimpleNamespace(rows={"A": None}))
