"""Structures of a map by their id, or by what is written on them: where "A21-03" is."""

import difflib
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.errors import SiteError
from savmap.maps.exports.frames import transformed, world_from_row
from savmap.types import Floats, Ints, SiteMap, Structure, array_record

WRITTEN = ("text", "code")
"""Attributes by which plugins give what is written on a structure; of "kind:content", the content counts too."""
PART = " / "
"""Between the parts of an id."""
BAY = "bay"
"""The attribute of what is written on a structure that says before which place it hangs, by that place's id."""
OTHER_WORD = re.compile(r"\bsection\b")
"""For a bay."""
PARTING = re.compile(r"\s*[/,;:]\s*|\s+(?:of|in|on)\s+")
NUMBERED = re.compile(r"([^\W\d_]+)[\s_]*(\d{1,9})(?!\d)")
LONGEST_NAME, MOST_LABELS = 500, 8
GUESSED_M, TIMES_WORSE = 0.1, 3.0
"""A vertex of which a coordinate has a larger standard deviation than this, m, and so many times that of a vertex of
the same structure, is a guess, such as the top of a post that no picture shows: where its structure is, it does not
tell."""
NO_EDGES = np.zeros((0, 2), dtype=np.int64)
InRow = tuple[str, Structure]
Places = Mapping[str, Mapping[str, Sequence[Structure]]]
"""Places between structures, by row and plugin."""


@dataclass(frozen=True, eq=False)
@array_record
class SearchHit:
    """A structure of a row: the mean (3,) m of those of its vertices that were measured, in the row's frame and, where
    that is known, in the site's and the user's world's; its standard deviations (3,) m along the row's axes; and what
    these vertices are called and the others are not, such as "bottom": empty where all were measured. `slot`: of what
    is written somewhere, the place that it names: the level on whose beam, or in whose opening, it hangs; the whole
    bay, where it hangs beside that."""

    row: str
    structure: Structure
    position_m: Floats
    sigma_m: Floats
    part: str = ""
    site_position_m: Floats | None = None
    world_position_m: Floats | None = None
    slot: "SearchHit | None" = None

    def __str__(self) -> str:
        attributes = self.structure.attributes
        text = f' "{attributes["text"]}"' if attributes.get("text") else ""
        others = [value for key, value in attributes.items() if isinstance(value, str) and value and key not in WRITTEN]
        what = ", ".join((f"row {self.row}", f"{self.structure.id}{text}", *others, *filter(None, [self.part])))
        sigmas = ", ".join(map(_millimetres, self.sigma_m))
        elsewhere = {"site": self.site_position_m, "world": self.world_position_m}
        more = [f"; in the {name} {_metres(place)}" for name, place in elsewhere.items() if place is not None]
        more += [f"; {name} {value:.3f} m +- {1000 * sigma:.1f} mm" for name, value, sigma in self.structure.sizes()]
        return f"{what}: {_metres(self.position_m)} (+- {sigmas} mm){''.join(more)}"


def find_structures(site: SiteMap, name: str, places: Callable[[], Places] = dict) -> list[SearchHit]:
    """The structures whose id, text or code is `name`, whatever its case; else those, their vertices and the places
    between structures (`places`, asked for where they are needed), that it describes: "bay 2", "beam 2", "level 3 of
    bay 2", "row B, bay 2"; a section is a bay. Of what it describes, the largest is meant: the bay, not each of its
    parts. Raises SiteError, with the nearest names, if there are none, and for an empty name."""
    if not name.strip():
        raise SiteError("the name to find is empty: give an id, or what is written on a structure")
    mapped = _mapped(site)
    hits = _called(mapped, name)
    if not hits:
        between = places()
        further = [(row, place) for row in between for place in _places_of(row, between)]
        further += [(row, vertex) for row, structure in mapped for vertex in _vertices(structure)]
        hits = _called(further, name) or _described(site, [*mapped, *further], name)
        mapped += further
    if not hits:
        spellings = sorted({key for _, structure in mapped for key in names(structure)})
        near = difflib.get_close_matches(name[:LONGEST_NAME], spellings, 3)
        more = f"; nearest: {', '.join(near)}" if near else _without_texts(site)
        raise SiteError(f"`{name}` is not in the map{more}")
    results = [_hit(site, row, structure) for row, structure in hits]
    named = places() if any(_names_place(hit.structure) for hit in results) else {}
    return [replace(hit, slot=_slot(site, hit, named)) for hit in results]


def _mapped(site: SiteMap) -> list[InRow]:
    return [
        (row.name, structure) for row in site.rows.values() for group in row.structures.values() for structure in group
    ]


def places_within(site: SiteMap, hit: SearchHit, places: Places) -> list[SearchHit]:
    """The places that a place consists of, such as the levels of a bay; none of a structure."""
    in_row = _places_of(hit.row, places)
    if all(place.id != hit.structure.id for place in in_row):
        return []
    return [_hit(site, hit.row, place) for place in in_row if place.id.startswith(f"{hit.structure.id}{PART}")]


def _places_of(row: str, places: Places) -> list[Structure]:
    return [place for group in places.get(row, {}).values() for place in group]


def _names_place(structure: Structure) -> bool:
    return isinstance(structure.attributes.get(BAY), str) and any(structure.attributes.get(key) for key in WRITTEN)


def _slot(site: SiteMap, hit: SearchHit, places: Places) -> SearchHit | None:
    """The place that what is written on a structure names: of the bay's levels the lowest that ends above it."""
    if not _names_place(hit.structure):
        return None
    name = _folded(str(hit.structure.attributes[BAY]))
    bay = next((place for place in _places_of(hit.row, places) if _folded(place.id) == name), None)
    if bay is None:
        return None
    x, y, _ = hit.structure.vertices.mean(axis=0)
    levels = places_within(site, _hit(site, hit.row, bay), places)
    if not levels or not bay.vertices[:, 0].min() <= x <= bay.vertices[:, 0].max():
        return _hit(site, hit.row, bay)
    return next((level for level in levels if level.structure.vertices[:, 1].max() > y), levels[-1])


def _without_texts(site: SiteMap) -> str:
    """What a map has instead, where nothing was read in it; nothing where something was."""
    structures = [structure for _, structure in _mapped(site)]
    if any(structure.attributes.get(key) for structure in structures for key in WRITTEN):
        return ""
    counted = Counter(structure.label for structure in structures).most_common(MOST_LABELS)
    has = ", ".join(f"{label} ({count})" for label, count in counted) or "nothing"
    return f": no text was read in it, which takes a plugin that reads them; it has {has}"


def _vertices(structure: Structure) -> Iterator[Structure]:
    """Its vertices, as structures that are called by both: "post 1 / top"."""
    for number, (name, label) in enumerate(zip(structure.vertex_names, structure.vertex_labels, strict=True)):
        chosen = slice(number, number + 1)
        yield Structure(name, label, structure.vertices[chosen], structure.covariances[chosen], (label,), NO_EDGES)


def _called(structures: Sequence[InRow], name: str) -> list[InRow]:
    """What has this name."""
    return [(row, structure) for row, structure in structures if _folded(name) in map(_folded, names(structure))]


def _folded(text: str) -> str:
    """A text in lower case, with one word for a bay."""
    return OTHER_WORD.sub(BAY, text.lower())


def _described(site: SiteMap, structures: Sequence[InRow], name: str) -> list[InRow]:
    """What fits all parts of a description, of which no other is a larger part."""
    for row in site.rows:
        name = re.sub(rf"\brow\s+{re.escape(row)}\s+(?=\w)", f"row {row}, ", name, flags=re.IGNORECASE)
    terms = _terms(name)
    rows = {f"row {row}".lower(): row for row in site.rows} | {row.lower(): row for row in site.rows}
    wanted = {rows[term] for term in terms if term in rows}
    rest = [term for term in terms if term not in rows]
    fits = [
        (row, structure)
        for row, structure in structures
        if rest and (not wanted or row in wanted) and all(_fits(structure, term) for term in rest)
    ]
    largest = min((structure.id.count(PART) for _, structure in fits), default=0)
    return [(row, structure) for row, structure in fits if structure.id.count(PART) == largest]


def _terms(name: str) -> list[str]:
    """The parts of a description in lower case: "Level 3 of section 2" is of "level 3" and "section 2"."""
    terms = list[str]()
    for part in PARTING.split(name.lower()[:LONGEST_NAME]):
        numbered = NUMBERED.findall(part)
        if numbered and not NUMBERED.sub("", part).strip():
            terms += [f"{word} {int(number)}" for word, number in numbered]
        elif part.strip():
            terms.append(part.strip())
    return terms


def _fits(structure: Structure, term: str) -> bool:
    """Whether a term is a part of a structure's id, its label, or says one of its attributes: "bay 2", where that is
    text or number."""
    values = {_folded(key): value for key, value in structure.attributes.items()}
    texts = [value for value in values.values() if isinstance(value, str)]
    word, _, number = _folded(term).rpartition(" ")
    counted = number.isdecimal() and isinstance(values.get(word), int) and values[word] == int(number)
    return counted or _folded(term) in map(_folded, (*structure.id.split(PART), structure.label, *texts))


def names(structure: Structure) -> list[str]:
    """The names by which a structure is found."""
    written = [str(structure.attributes[key]) for key in WRITTEN if structure.attributes.get(key)]
    return [structure.id, *written, *(text.partition(":")[2] for text in written if ":" in text)]


def _hit(site: SiteMap, row: str, structure: Structure) -> SearchHit:
    worst = np.sqrt(np.diagonal(structure.covariances, axis1=1, axis2=2)).max(axis=1)
    measured = np.flatnonzero((worst <= GUESSED_M) | (worst <= TIMES_WORSE * worst.min()))  # all, if none stands out
    middle = structure.vertices[measured].mean(axis=0)
    sigma: Floats = np.sqrt(np.diagonal(structure.covariances[measured].mean(axis=0)))
    placement, only = site.placements.get(row), len({*site.rows, *site.failed}) == 1
    in_world = site.alignment is not None and (placement is not None or only)
    return SearchHit(
        row,
        structure,
        middle,
        sigma,
        _part(structure, measured),
        None if placement is None else placement.points(middle[None])[0],
        transformed(middle[None], world_from_row(site, row))[0] if in_world else None,
    )


def _part(structure: Structure, measured: Ints) -> str:
    """What the labels of these vertices say and those of no others do."""
    words = [label.split(PART) for label in structure.vertex_labels]
    others = {word for number, label in enumerate(words) if number not in measured for word in label}
    shared = set(words[measured[0]]).intersection(*(words[number] for number in measured)) - others
    return PART.join(word for word in words[measured[0]] if word in shared) if others else ""


def _metres(point: Floats) -> str:
    x, y, z = point
    return f"x {x:.3f}, y {y:.3f}, z {z:.3f} m"


def _millimetres(sigma_m: float) -> str:
    return f"{1000 * sigma_m:.{0 if sigma_m >= 0.001 else 1}f}"
