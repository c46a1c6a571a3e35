"""Numbers, names, ticks and boxes of the report."""

import numpy as np
import pytest

from savmap.report.box_plot import box_of, box_plot
from savmap.report.numbers import anchors, duration, fixed, natural, shortened
from savmap.report.page.tables import alignment_facts, alignment_table
from savmap.report.page.uncertainty import histogram
from savmap.report.scene import hatching, path, ticks
from savmap.types import Alignment, AlignmentResidual, Evaluation, Score


@pytest.mark.parametrize(
    ("value", "plus", "text"),
    [
        (1.234, False, "1.23"),
        (-1.0, True, "\u22121.00"),
        (0.004, True, "0.00"),
        (-0.004, False, "0.00"),
        (2.0, True, "+2.00"),
        (None, True, "\u2013"),
        (float("nan"), False, "\u2013"),
    ],
)
def test_numbers_have_a_true_minus_and_zero_has_no_sign(value: float | None, plus: bool, text: str) -> None:
    assert fixed(value, 2, plus) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(4.21, "4.2 s"), (200, "3 min 20 s"), (7440, "2 h 04 min"), (3599.9, "1 h 00 min")]
)
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_names_are_in_the_order_in_which_people_count() -> None:
    assert natural(["A10", "A2", "10", "B", "9", "A2b"]) == ["9", "10", "A2", "A2b", "A10", "B"]


def test_anchors_are_all_different() -> None:
    assert anchors(["A 1", "A-1", "\u00e4", ""]) == {
        "A 1": "row-A-1",
        "A-1": "row-A-1-2",
        "\u00e4": "row-x",
        "": "row-x-2",
    }


def test_long_names_are_cut() -> None:
    assert shortened("short") == "short"
    assert shortened("a" * 30, 10) == "a" * 9 + "\u2026"


def test_paths_are_relative_whole_numbers_that_do_not_drift() -> None:
    assert path(np.array([[0.4, 0.6], [10.4, 0.6], [10.4, 5.4], [3.0, 2.0]]), closed=True) == "M0 1h10v4l-7-3z".replace(
        "l-7-3", "l-7 -3"
    )
    assert path(np.array([[3.0, 4.0]])) == "M3 4h0"


def test_ticks_are_round_and_inside() -> None:
    assert ticks(-0.4, 55.2, 12) == [5.0 * k for k in range(12)]
    assert np.allclose(ticks(-1.6, 1.6, 8), [-1.5, -1, -0.5, 0, 0.5, 1, 1.5])


def test_boxes_are_tukeys_as_matplotlib_has_them() -> None:
    from matplotlib.cbook import boxplot_stats

    errors = np.append(np.random.default_rng(3).normal(0.3, 1, 200), [9.0, -7.0])
    (known,) = boxplot_stats(errors)
    box = box_of(errors)
    names = ("whislo", "q1", "med", "q3", "whishi", "mean")
    assert np.allclose([box.low, box.first, box.median, box.third, box.high, box.mean], [known[name] for name in names])
    assert sorted(box.beyond) == pytest.approx(sorted(known["fliers"]))


def test_what_does_not_fit_the_box_plot_is_counted() -> None:
    errors = np.append(np.linspace(-0.01, 0.01, 50), [3.0])
    figure = box_plot(Evaluation({"A": Score({"H gap": errors, "none": np.zeros(0)})}))
    assert figure is not None
    assert [label.text for label in figure.labels if "class" in label.style] == ["H gap", "(51, 1 beyond the axis)"]
    assert box_plot(Evaluation({"A": Score()})) is None


def test_equal_errors_have_a_box_too() -> None:
    assert box_plot(Evaluation({"A": Score({"H gap": np.full(3, 0.01)})})) is not None


def test_hatching_stays_within_and_fills() -> None:
    strokes = np.array(hatching(np.array([[100.0, 0.0], [400.0, -900.0]])))
    assert strokes.reshape(-1, 2).min(axis=0) == pytest.approx([100, -900])
    assert strokes.reshape(-1, 2).max(axis=0) == pytest.approx([400, 0])
    rise, run = np.diff(strokes, axis=1)[:, 0, ::-1].T
    np.testing.assert_allclose(rise, -run, atol=1e-9)
    assert len(strokes) == 20
    assert hatching(np.array([[1.0, 2.0], [1.0, 9.0]])) == []


def test_histograms_are_logarithmic_and_lose_nothing() -> None:
    heights = histogram(np.array([1e-6, 0.01, 0.01, 5.0]))
    assert (heights[0], heights[16], heights[-1]) == (0.5, 1.0, 0.5)
    assert sum(heights) == 2.0


def test_places_in_the_users_world_are_a_table() -> None:
    residuals = (
        AlignmentResidual("A", "<b>", np.array([0.01, -0.02, np.nan]), np.full(3, 0.01), 1.25),
        AlignmentResidual("A", "c", np.array([0.5, 0.0, 0.1]), np.full(3, 0.01), 50.0, used=False),
    )
    aligned = Alignment(1.0, 2.0, 30.0, np.diag([1e-4, 4e-4, 0.01]), residuals=residuals)
    table = alignment_table(aligned)
    assert dict(alignment_facts(aligned))["origin y"] == "2.000 \u00b1 0.020 m"
    assert [cell.text for cell in table.lines[0].cells] == ["<b>", "A", "+1.00", "\u22122.00", "\u2013", "1.2", "yes"]
    assert [line.style for line in table.lines] == ["", "off"]
