"""The verdict: which structures too few frames support, which do not fit, and what plugins warn of."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.errors import MustCheckError
from savmap.graph import Landmark, References, camera_priors, solve_rows
from savmap.graph.solver.residuals import DirectionalErrors
from savmap.graph.solver.solution import LensDistanceError, VerticalScaleError
from savmap.jobs.map_site import SiteRun
from savmap.maps.run_record import RunLog
from savmap.pipeline.records import DescribedRow, LocatedRow, PosedRow, RowMeasurements, RowRequest, SolvedRow
from savmap.pipeline.row import collect, constrain, track, with_unchecked
from savmap.pipeline.trust.support import Support, supports
from savmap.pipeline.trust.verdict import judge
from savmap.plugin.hookspecs import hookimpl
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.types import Feature, FoundObject, JointCovariance, MapWarning, RowMap, SiteMap, Structure, Track, Verdict
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
    structures, verdict = judge(row)
    assert verdict.grade == "trusted"
    hidden = "(any error would stay hidden). To check it:"
    length = f"length {LENGTH.start} to {LENGTH.end}"
    assert sorted(verdict.notes) == [
        f"not checked by a second reference: camera height {hidden} a height on the structure",
        f"not checked by a second reference: {length} {hidden} one more length",
    ]
    assert {own.attributes["support"] for own in structures["wall"]} == {1.0}
    unchecked = [own.unchecked_m for own in collect(row).structures["wall"]]
    assert all(off_m is not None and off_m > 1 for off_m in unchecked)


def test_what_was_not_solved_for_is_as_unchecked_as_the_row() -> None:
    """Of what was solved for, the largest error of any of its coordinates is told."""
    posts = [replace(post(0), id=name) for name in "abc"]
    numbers = {"a": np.array([[0, -1, 1]]), "b": np.array([[-1, -1, 1]])}
    joint = JointCovariance({"wall": numbers}, np.eye(2), np.array([[0.1, -0.2], [-0.3, 0.0]]))
    for known, wanted in (
        (joint, [0.3, 0.2, 0.4]),
        (None, [0.4] * 3),
        (replace(joint, hidden=np.zeros((0, 1))), [0.4] * 3),
    ):
        assert [with_unchecked("wall", part, known, 0.4).unchecked_m for part in posts] == wanted
    assert with_unchecked("wall", posts[0], None, 0.0) is posts[0]


@pytest.mark.parametrize(
    ("off", "warnings"),
    [
        ({"wall": (0.05, 0.2), "lamps": (0.1, 0.3)}, 1),
        ({"wall": (0.05, 0.2), "lamps": (0.1, 0.05)}, 0),
        ({"wall": (0.01, 0.2), "lamps": (0.1, 0.3)}, 0),
    ],
)
def test_pictures_that_are_no_panoramas(off: dict[str, tuple[float, float]], warnings: int) -> None:
    """What locates the camera may look different from aslant; something else that is off in the same way does not by chance."""
    row = mapped(Wall)
    directional = {plugin: DirectionalErrors(*values) for plugin, values in off.items()}
    _, verdict = judge(replace(row, solution=replace(row.solution, directional=directional)))
    assert [warning.code for warning in verdict.warnings] == warnings * ["bad-panorama"]


@pytest.mark.parametrize(
    ("share", "sigma", "warned"),
    [(0.01, 0.001, "1.00 ± 0.10 % too large"), (-0.01, 0.001, "too small"), (0.01, 0.003, ""), (0.0015, 0.0001, "")],
)
def test_stretched_pictures(share: float, sigma: float, warned: str) -> None:
    row = mapped(Wall)
    off = {plugin: DirectionalErrors(0.05, 0.2) for plugin in ("wall", "lamps")} if warned else {}
    solution = replace(row.solution, vertical_scale=VerticalScaleError(share, sigma), directional=off)
    _, verdict = judge(replace(row, solution=solution))
    assert [warning.code for warning in verdict.warnings] == (["stretched-pictures"] if warned else [])
    assert all(warned in warning.figure and "vertical_scale: true" in warning.action for warning in verdict.warnings)


@pytest.mark.parametrize(
    ("displacement", "deviation", "warned"),
    [(0.015, 5.0, "lenses 3.0 ± 0.5 cm apart"), (0.015, 3.0, ""), (0.001, 5.0, "")],
)
def test_pictures_bent_at_the_seam(displacement: float, deviation: float, warned: str) -> None:
    row = mapped(Wall)
    solution = replace(row.solution, lens_distance=LensDistanceError(0.03, 0.005, displacement, deviation))
    _, verdict = judge(replace(row, solution=solution))
    assert [warning.code for warning in verdict.warnings] == (["lens-seam"] if warned else [])
    assert all(warned in warning.figure and "lens_distance: true" in warning.action for warning in verdict.warnings)


def test_what_is_said_twice_is_told_once() -> None:
    row = mapped(Wall)
    warning = MapWarning("uncertain-element", ("post 7",))
    measurements = replace(row.measurements, warnings=(warning, warning))
    _, verdict = judge(replace(row, measurements=measurements, notes=("one pass", "one pass")))
    assert verdict.warnings == (warning,)
    assert verdict.notes.count("one pass") == 1


@pytest.mark.parametrize(("turned_deg", "frame", "refuted"), [(0.0, 6, True), (60.0, 6, False), (0.0, None, False)])
def test_a_turn_that_the_solved_path_does_not_show_is_none(turned_deg: float, frame: int | None, refuted: bool) -> None:
    row = mapped(Wall)
    poses = row.solution.trajectory.world_from_rig.copy()
    poses[5:8, :3, :3] = Rotation.from_euler("y", turned_deg, degrees=True).as_matrix() @ poses[5:8, :3, :3]
    path = replace(row.solution.trajectory, world_from_rig=poses)
    warning = MapWarning("camera-motion", frame=frame)
    row = replace(row, measurements=replace(row.measurements, warnings=(warning,)))
    _, verdict = judge(replace(row, solution=replace(row.solution, trajectory=path)))
    assert (warning in verdict.warnings) != refuted


def test_a_structure_whose_measurements_do_not_fit_is_warned_of() -> None:
    class Mistaken(Wall):
        """Half of the frames take something else for post 7, far from it."""

        def tracks(self) -> list[Track]:
            found = super().tracks()
            moved = found[7].pixels + np.where(found[7].frames % 2 == 1, 30.0, 0.0)[:, None]
            return [*found[:7], replace(found[7], pixels=moved), *found[8:]]

    _, verdict = judge(mapped(Mistaken))
    assert [(warning.code, warning.subjects) for warning in verdict.warnings] == [("inconsistent-element", ("post 7",))]


def offset(*metres: float, used: int) -> Landmark:
    """A landmark whose measurements are so far off, the first of which were used."""
    return Landmark(made.WALL[7], 1e-6 * np.eye(3), used, np.array(metres))


@pytest.mark.parametrize(
    ("landmark", "told"),
    [
        (offset(0.001, 0.001, 0.03, 0.03, 0.04, 0.04, used=2), "4 of 6 rejected"),
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
    assert [warning.figure for warning in verdict.warnings] == ([told] if told else [])


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


def test_a_structure_that_few_frames_measured_is_warned_of() -> None:
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
    assert [(warning.code, warning.subjects) for warning in verdict.warnings] == [("uncertain-element", ("post 4",))]
    assert verdict.grade == "check"


FEW, MOST = range(3), range(1, made.FRAMES)
LIT, GLARING, WHITE, DARK = (0.0, 0.0), (0.0, 0.1), (0.0, 0.95), (0.92, 0.0)


@pytest.mark.parametrize(
    ("every", "measured", "kept", "tone", "missed"),
    [
        (False, MOST, (), LIT, 11),  # nothing mapped, though most frames show something
        (False, FEW, (), LIT, 0),
        (False, MOST, FEW, LIT, 0),  # what need not be in every frame
        (True, MOST, FEW, LIT, 9),  # a stray one mapped, and nothing of what the others show
        (True, MOST, MOST, GLARING, 0),  # all found, however bright it is
        (True, FEW, FEW, LIT, 0),  # nothing else shows in the others
        (True, FEW, FEW, GLARING, 9),
        (True, FEW, FEW, DARK, 0),  # what shines would show
        (False, FEW, FEW, GLARING, 0),
        (False, FEW, FEW, WHITE, 9),
        (False, FEW, FEW, DARK, 9),
        (False, MOST, MOST, DARK, 0),
    ],
)
def test_frames_of_which_nothing_is_mapped_are_warned_of(
    every: bool, measured: Sequence[int], kept: Sequence[int], tone: tuple[float, float], missed: int
) -> None:
    row = mapped(Wall)
    pixel, covariance = np.zeros((1, 2)), np.eye(2)[None]
    seen = [Feature(frame, made.VIEW, "lamp", "centre", 1, pixel, covariance) for frame in measured]
    frames = np.array(kept, np.int64)
    views, pixels = (made.VIEW,) * len(frames), np.zeros((len(frames), 2))
    track = Track("lamp 1", "lamp", {}, frames, views, pixels, np.tile(np.eye(2), (len(frames), 1, 1)))
    lamps: LoadedPlugin = loaded_plugin("lamps", type("Lamps", (made.Wall,), {"in_every_frame": every}), made.Config())
    measurements = replace(
        row.measurements,
        features={**row.measurements.features, "lamps": seen},
        tones=[{"wall": LIT, "lamps": tone}] * made.FRAMES,
    )
    structures = (replace(post(1), id="lamp 1", attributes={"probability": 1.0}),) if kept else ()
    row = replace(
        row,
        request=replace(row.request, plugins=[*row.request.plugins, lamps]),
        measurements=measurements,
        tracks={**row.tracks, "lamps": [track] if kept else []},
        structures={**row.structures, "lamps": structures},
    )
    found = [warning.figure for warning in judge(row)[1].warnings if warning.subjects == ("lamps",)]
    assert found == ([f"nothing mapped in {missed} of {made.FRAMES} frames"] if missed else [])


@pytest.mark.parametrize(("x", "kept"), [(2.0, True), (9.0, False)])
def test_a_place_beyond_the_rows_ends_is_not_warned_of(x: float, kept: bool) -> None:
    class Beside(Wall):
        @hookimpl
        def warnings(self) -> list[MapWarning]:
            return [MapWarning("incomplete-map", ("wall",), "something is there", (x, 1.0, 0.0))]

    assert len(judge(mapped(Beside))[1].warnings) == kept


def test_what_a_plugin_the_footage_and_the_solve_warn_of_is_kept() -> None:
    shape, motion = MapWarning("inaccurate-element", ("post 1",)), MapWarning("camera-motion", figure="at 3.0 s")

    class Odd(Wall):
        @hookimpl
        def warnings(self) -> list[MapWarning]:
            return [shape]

    row = mapped(Odd)
    row = replace(row, measurements=replace(row.measurements, warnings=(motion,)))
    reference = MapWarning("reference-conflict", ("length",))
    row = replace(row, solution=replace(row.solution, warnings=(reference,)))
    assert collect(row).verdict == Verdict((motion, reference, shape), row.solution.unchecked)


def lamp(number: int, *x: float) -> Structure:
    vertices = np.array([[along, 5.0, 1.0] for along in x])
    covariances = np.tile(1e-6 * np.eye(3), (len(x), 1, 1))
    return Structure(f"lamp {number}", "lamp", vertices, covariances, tuple("ab"[: len(x)]), np.zeros((0, 2), np.int64))


def test_nothing_is_warned_of_beyond_the_ends() -> None:
    """A lamp that is mapped from afar, and one that was only found there, are none of the row's."""
    ends = made.WALL[:, 0].min(), made.WALL[:, 0].max()
    along = {1: float(np.mean(ends)), 2: ends[1] - 0.1, 3: ends[1] + 0.1, 4: ends[0] - 1.5}
    lamps = [replace(lamp(number, x, x + 1.0), attributes={"probability": 0.5}) for number, x in along.items()]
    found = [
        FoundObject(f"lamp {number}", "lamp", np.array([[x, 5.0, 1.0]]), probability)
        for number, x, probability in ((5, 2.0, 0.3), (6, 2.0, 0.002), (7, 40.0, 0.3))
    ]
    row = mapped(Wall)
    others: LoadedPlugin = loaded_plugin("lamps", made.Wall, made.Config())
    row = replace(
        row,
        request=replace(row.request, plugins=[*row.request.plugins, others]),
        structures={**row.structures, "lamps": tuple(lamps)},
        uncertain=tuple(found),
    )
    warned = [warning.subjects for warning in judge(row)[1].warnings]
    assert warned == [("lamp 5",), ("lamp 1",), ("lamp 2",)]


@pytest.mark.parametrize(("probability", "warned"), [(0.995, False), (0.98, True), (0.3, True), (0.005, False)])
def test_what_may_not_exist_is_warned_of(probability: float, warned: bool) -> None:
    class Unsure(Wall):
        @hookimpl
        def describe(self) -> list[Structure]:
            first, *others = super().describe()
            return [replace(first, attributes={"probability": probability}), *others]

    _, verdict = judge(mapped(Unsure))
    figures = [(warning.subjects, warning.figure) for warning in verdict.warnings]
    assert figures == [(("post 0",), f"P {probability:.2f}")] * warned


@pytest.mark.parametrize(("sigma", "warned"), [(0.04, True), (0.015, False)])
def test_a_place_that_is_hardly_known_is_warned_of(sigma: float, warned: bool) -> None:
    class Vague(Wall):
        @hookimpl
        def describe(self) -> list[Structure]:
            first, *others = super().describe()
            return [replace(first, covariances=np.diag([1e-6, sigma**2, 1e-6])[None]), *others]

    _, verdict = judge(mapped(Vague))
    expected = [("inaccurate-element", ("post 0",), f"y known to {100 * sigma:.1f} cm")]
    assert [(one.code, one.subjects, one.figure) for one in verdict.warnings] == expected * warned


def test_where_all_are_known_less_well_the_references_say_so() -> None:
    class Vague(Wall):
        @hookimpl
        def describe(self) -> list[Structure]:
            return [replace(post, covariances=1e-2 * np.eye(3)[None]) for post in super().describe()]

    assert judge(mapped(Vague))[1].grade == "trusted"


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


def test_a_checked_map_ends_with_its_own_exit_code(tmp_path: object) -> None:
    row = collect(mapped(Wall))
    checked: RowMap = replace(row, verdict=Verdict((MapWarning("uncertain-element", ("post 1",)),)))
    run = SiteRun(SiteMap({"A": checked}, {}), None, RunLog(rows={}), {}, frozenset())
    with pytest.raises(
        MustCheckError, match="mapped, but 1 of 1 row must be checked: A; the reasons are above"
    ) as caught:
        run.raise_if_incomplete(made_job())
    assert caught.value.exit_code == 12
    replace(run, site_map=SiteMap({"A": row}, {})).raise_if_incomplete(made_job())


def made_job() -> object:
    from pathlib import Path
    from types import SimpleNamespace

    return SimpleNamespace(output=Path("out"), site=SimpleNamespace(rows={"A": None}))
