"""What is off in the same direction of the camera in all frames is told from what is off anyhow."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from savmap.graph.problem import Estimate, first_poses
from savmap.graph.solver.residuals import DirectionalErrors, Fit, directional_errors
from savmap.types import Floats

from . import made_up_wall as made

POINTS = np.array([[x, y, 0.0] for x in np.linspace(0.0, 4.0, 9) for y in (0.4, 0.9, 1.4, 1.9, 2.4)])


def found(moved: Callable[[Floats], Floats]) -> DirectionalErrors | None:
    """The directional errors of points on a wall at their true places, whose pixels (n, 2) are moved."""
    tracks = [made.track(f"post {number}", point, "post") for number, point in enumerate(POINTS)]
    tracks = [replace(track, pixels=track.pixels + moved(track.pixels)) for track in tracks]
    problem = made.problem_of(tracks, POINTS)
    estimate = Estimate(first_poses(problem), POINTS, np.zeros(0), {})
    count = len(problem.measurements)
    fit = Fit(np.zeros((count, 2)), np.ones(count, np.bool_), 1.0, np.ones(count), np.ones(count))
    return directional_errors(problem, estimate, fit).get("wall")


def test_noise_has_no_direction() -> None:
    rng = np.random.default_rng(2)
    off = found(lambda pixels: rng.normal(0, 0.3, pixels.shape))
    assert off is not None
    assert off.share < 0.12


@pytest.mark.parametrize("pixels_off", [0.5, 2.0])
def test_pictures_that_are_bent_at_a_seam(pixels_off: float) -> None:
    """Towards the seam in the middle of the view, from either side."""
    middle = made.SPEC.width / 2

    def bent(pixels: Floats) -> Floats:
        towards = np.where(np.abs(pixels[:, 0] - middle) < 60, np.sign(middle - pixels[:, 0]), 0.0)
        return pixels_off * np.stack([towards, np.zeros(len(pixels))], axis=1)

    off = found(bent)
    assert off is not None
    assert off.share > 0.2
    assert off.angle_deg == pytest.approx(0.2 * pixels_off, rel=0.3)


def test_too_few_measurements_tell_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.graph.solver.residuals.FEWEST", 10_000)
    assert found(lambda pixels: np.zeros_like(pixels)) is None
