"""Sheets of pictures: the parts of rows that an inspector wants to see, several to a page, and each as a file."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, floor
from pathlib import Path

from savmap.apps.inspection.page import InspectionPage
from savmap.apps.inspection.pictures import FacePictures, PartPicture
from savmap.apps.inspection.words import FindingText, text_of
from savmap.files.atomic import file_name, write_bytes
from savmap.report.templating import jpeg_address, rendered_page
from savmap.types import CloseUp, RowMap

MOST_PX = 900
LABEL_M = 0.4
"""What is written no further than this to the left or right of a part is named with it."""
LONGEST_NAME = 80
STEP_M = 0.5
"""Of the scale of heights."""
SEEN_PX = 3
"""What is smaller in a picture cannot be told from its noise."""
MM = 1000.0
SAME = 0.02
"""Of a step: a mark that is so far out of the picture is at its edge."""


@dataclass(frozen=True)
class SheetPicture:
    """A picture of a sheet: its row, what stands under it, the texts that hang there, what was measured of what it
    shows, and the picture."""

    row: str
    title: str
    texts: tuple[str, ...]
    measured: tuple[FindingText, ...]
    part: PartPicture

    @property
    def address(self) -> str:
        """The picture as an address that needs no file."""
        return jpeg_address(self.part.content)

    @property
    def resolution(self) -> str:
        """How large a pixel is, and what is too small to be seen."""
        pixel_mm = MM * self.part.pixel_m
        return f"1 pixel is {pixel_mm:.1f} mm: dents smaller than about {SEEN_PX * pixel_mm:.0f} mm cannot be seen"

    @property
    def heights(self) -> list[tuple[str, float]]:
        """Marks of a scale of heights: metres, and where, in percent of the picture's height from its lower edge."""
        low, high = self.part.low_m, self.part.high_m
        steps = range(ceil(low / STEP_M - SAME), floor(high / STEP_M + SAME) + 1)
        return [(f"{k * STEP_M:g}", 100 * (k * STEP_M - low) / (high - low)) for k in steps]

    @property
    def file(self) -> str:
        """Its file's name: place and label."""
        words = "-".join("_".join(text.split()) for text in (self.row, self.title, *self.texts))
        return f"{file_name(words[:LONGEST_NAME])}.jpg"


def sheet_pictures(page: InspectionPage) -> Iterator[SheetPicture]:
    """The parts that plugins want to be shown, of rows that have an orthophoto, as far as it shows them."""
    for row, photo in page.photos.items():
        pictures = FacePictures(photo)
        for part in (part for said in page.inspection.rows.get(row, {}).values() for part in said.close_ups):
            picture = pictures.part(part.corners, most_px=MOST_PX)
            if picture is not None:
                findings = [finding for said in page.inspection.rows[row].values() for finding in said.findings]
                of_part = [finding for finding in findings if finding.subjects == (part.subject,)]
                measured = tuple(text_of(row, finding) for finding in of_part if finding.value is not None)
                texts = texts_at(page.site_map.rows[row], part)
                yield SheetPicture(row, part.title, texts, measured, picture)


def texts_at(row: RowMap, part: CloseUp) -> tuple[str, ...]:
    """What is written on structures near a part, from the left."""
    low, high = part.corners[:, 0].min() - LABEL_M, part.corners[:, 0].max() + LABEL_M
    written = [
        (float(structure.vertices[:, 0].mean()), str(structure.attributes["text"]))
        for structures in row.structures.values()
        for structure in structures
        if structure.attributes.get("text")
    ]
    return tuple(text for x, text in sorted(written) if low <= x <= high)


def write_sheets(page: InspectionPage, path: Path) -> list[Path]:
    """Write the page of sheets, and each picture as a file in a folder of the same name; their paths, none where there
    are no pictures. Raises OutputError."""
    shown = list(sheet_pictures(page))
    if not shown:
        return []
    folder = path.with_suffix("")
    files = {folder / picture.file: picture.part.content for picture in shown}
    for file, content in files.items():
        write_bytes(file, content)
    write_bytes(
        path, rendered_page("sheets.html.jinja", __package__, title=f"{page.title}: sheets", pictures=shown).encode()
    )
    return [path, *files]
