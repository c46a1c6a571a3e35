"""Records of trust: what speaks against a row's map, and the verdict that follows from it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from savmap.types.common import require

WarningCode = Literal[
    "uncertain-element",
    "inconsistent-element",
    "inaccurate-element",
    "incomplete-map",
    "reference-conflict",
    "doubtful-scale",
    "bad-panorama",
    "stretched-pictures",
    "lens-seam",
    "missing-frames",
    "camera-motion",
    "site-misfit",
]
"""What a warning comes from: one code a cause."""

NAMED = 2
"""Of the subjects of a warning, in its action."""


@dataclass(frozen=True)
class WarningKind:
    """What is told with a code: a headline, what to do (the subjects' names follow), and one line of explanation.

    `of_elements`: its subjects are elements, and nothing is said of the others. `of`: the noun that several of its
    subjects are counted by."""

    headline: str
    action: str
    explanation: str
    of: str = "elements"
    of_elements: bool = False


WARNINGS: Mapping[WarningCode, WarningKind] = {
    "uncertain-element": WarningKind(
        "it is uncertain whether an element exists",
        "look whether it is there",
        "the probability that a mapped element exists, or one that was found and not mapped, is between 1 % and 99 %; "
        "without a probability: less than a fifth of the frames that should show an element measured it",
        of_elements=True,
    ),
    "inconsistent-element": WarningKind(
        "measurements of an element do not agree",
        "look whether it is one element",
        "most of its measurements were rejected and are over 1 cm off; or half of them are over 2 cm off, and four "
        "times what is usual",
        of_elements=True,
    ),
    "inaccurate-element": WarningKind(
        "an element's place is not known well",
        "look where it is",
        "a coordinate has a standard deviation of more than 3 cm, and three times what is usual, for hardly a frame "
        "shows an edge or an end",
        of_elements=True,
    ),
    "incomplete-map": WarningKind(
        "a part may be missing from the map",
        "look whether it is missing",
        "a plugin mapped nothing of what half of the frames show, or a fifth where each should show something; or "
        "these are dark or overexposed; or it saw something as often as what it mapped; or only a part of the row was "
        "found",
        of="parts",
    ),
    "reference-conflict": WarningKind(
        "a reference contradicts the rest",
        "measure it again, in metres",
        "the pictures and the other references contradict a given value; or rows of one drive contradict one another",
        of="references",
    ),
    "doubtful-scale": WarningKind(
        "the map's scale is doubtful",
        "give a measured length, in metres",
        "nobody measured what gives the scale or the place, or that does not fit what was measured; or no such "
        "structure has the sizes that the map has",
        of="reasons",
    ),
    "bad-panorama": WarningKind(
        "the pictures may be no whole panoramas, or of another camera than was said",
        "write whole equirectangular panoramas of one aisle, neither cropped nor stretched; or give the camera's "
        "calibration",
        "halves of the pictures are alike, their edges do not meet, a whole class of measurements does not fit "
        "together, or measurements are off in the same directions of the camera in all frames",
        of="reasons",
    ),
    "stretched-pictures": WarningKind(
        "the pictures were cropped or stretched",
        "export whole panoramas, or set `calibration: {vertical_scale: true}`",
        "a solve with one factor of all elevations says that this is not 1",
        of="reasons",
    ),
    "lens-seam": WarningKind(
        "the pictures are bent at a seam",
        "turn a lens towards the row, or set `calibration: {lens_distance: true}`",
        "a solve with the lenses' distance says that this is not 0, and the seam crosses the face",
        of="reasons",
    ),
    "missing-frames": WarningKind(
        "frames are missing, or the picture changes at once",
        "give each straight drive as a pass of its own (start_s, end_s; `savmap split` finds them)",
        "a cut, a gap, or a camera that is carried or covered: what lies between may be missing, or counted wrongly",
        of="times",
    ),
    "camera-motion": WarningKind(
        "the camera did not go straight along the row",
        "give each straight drive as a pass of its own (start_s, end_s; `savmap split` finds them)",
        "it goes back, turns, leaves the row's direction or stands; or a frame was solved far from its neighbours",
        of="times",
    ),
    "site-misfit": WarningKind(
        "the row does not fit the others of the site",
        "check the references, places and `side` of these rows",
        "two rows look at the same face; a row stands elsewhere than it was given; rows put a landmark or the drive "
        "that both saw in different places",
        of="reasons",
    ),
}
"""The codes, as docs/verdict.md lists them."""


@dataclass(frozen=True)
class MapWarning:
    """Something that speaks against a part of a map: its `code`, from which headline and action follow; `subjects`, the
    ids of what it is about (structures, references, rows, plugins), none where it is about the whole row; one `figure`
    with its unit, "" where there is none; `details`: further lines, for those who ask.

    `place` (3,) m in the row's frame, and `frame`, the number of one that shows it best, where that is known. `size`:
    of several with one code, the largest speaks for all."""

    code: WarningCode
    subjects: tuple[str, ...] = ()
    figure: str = ""
    place: tuple[float, float, float] | None = None
    frame: int | None = None
    details: tuple[str, ...] = ()
    size: float = 0.0

    def __post_init__(self) -> None:
        require(self.code in WARNINGS, self, f"`code` must be one of {', '.join(WARNINGS)}: {self.code!r}")
        texts = (self.figure, *self.details)
        require(not any("\n" in text for text in texts), self, "each of its texts must be one line")

    @property
    def headline(self) -> str:
        """What it says, without names."""
        return WARNINGS[self.code].headline

    @property
    def action(self) -> str:
        """What to do, with the first of its subjects."""
        names, more = self.subjects[:NAMED], len(self.subjects) - NAMED
        named = f"{', '.join(names)}{f' and {more} more' if more > 0 else ''}"
        return f"{WARNINGS[self.code].action}{f': {named}' if named else ''}"

    @property
    def line(self) -> str:
        """All but the details."""
        return f"{self.code}: {self.headline}{f', {self.figure}' if self.figure else ''}; {self.action}"

    @property
    def of_row(self) -> bool:
        """Whether it is about all elements of the row."""
        return not WARNINGS[self.code].of_elements


def by_code(warnings: Iterable[MapWarning]) -> tuple[MapWarning, ...]:
    """The warnings, those of one code as one, in the order of the codes. Its figure is how many they are, and that of
    the one with the largest `size`; its details are those of all."""
    of_code: dict[WarningCode, list[MapWarning]] = {}
    for warning in dict.fromkeys(warnings):
        of_code.setdefault(warning.code, []).append(warning)
    return tuple(_as_one(of_code[code]) for code in WARNINGS if code in of_code)


def _as_one(alike: Sequence[MapWarning]) -> MapWarning:
    if len(alike) == 1:
        return alike[0]
    worst = max(alike, key=lambda warning: warning.size)
    ordered = [worst, *(warning for warning in alike if warning is not worst)]
    subjects = tuple(dict.fromkeys(name for warning in ordered for name in warning.subjects))
    kind = WARNINGS[worst.code]
    count = f"{len(subjects) if kind.of_elements else len(alike)} {kind.of}"
    lines = (line for warning in alike for line in (_told(warning), *warning.details) if line)
    return replace(
        worst,
        subjects=subjects,
        figure=f"{count}, the worst {worst.figure}" if worst.figure else count,
        details=tuple(dict.fromkeys(lines)),
    )


def _told(warning: MapWarning) -> str:
    """What only this one of several says."""
    return ": ".join(part for part in (", ".join(warning.subjects), warning.figure) if part)


@dataclass(frozen=True)
class Verdict:
    """Whether a row's map may be used as it is: where nothing speaks against it, it is `trusted`; otherwise a person
    should `check` what the warnings name. `notes`, one line each: what the verdict rests on that nothing checks; they
    are no warnings."""

    warnings: tuple[MapWarning, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def grade(self) -> Literal["trusted", "check"]:
        """In one word."""
        return "check" if self.warnings else "trusted"
