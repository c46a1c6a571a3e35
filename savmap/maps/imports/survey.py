"""Elements in their rows' frames to a survey: each plugin makes its part of each row's entry."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.errors import OutputError
from savmap.maps.imports.records import Found, listed
from savmap.maps.schema import FARTHEST_M
from savmap.types import Structure, Survey, SurveyEntry

EntryHook = Callable[[str, Sequence[Structure]], SurveyEntry]


@dataclass(frozen=True)
class ImportedSurvey:
    """A survey, how many elements of each label went into each row, and what was left out."""

    survey: Survey
    counts: Mapping[str, Mapping[str, int]]
    notes: tuple[str, ...] = ()

    def lines(self) -> Iterator[str]:
        """What was read, row by row, then the notes."""
        for row, counts in self.counts.items():
            yield f"row {row}: " + ", ".join(f"{count} {label}" for label, count in counts.items())
        yield from (f"note: {note}" for note in self.notes)


def survey_of(found: Sequence[Found], plugins: Mapping[str, Sequence[str]], entry_of: EntryHook) -> ImportedSurvey:
    """A survey of elements in their rows' frames. `plugins`: the labels that each takes. `entry_of(plugin, elements)`
    asks one. Raises OutputError where no element has a label that a plugin takes, or a plugin refuses them."""
    plugin_of = {label.casefold(): (plugin, label) for plugin, labels in plugins.items() for label in labels}
    known = [one for one in found if one.structure.label.casefold() in plugin_of]
    others = Counter(one.structure.label for one in found if one.structure.label.casefold() not in plugin_of)
    names = listed(label for _, label in plugin_of.values())
    if not known:
        raise OutputError(f"nothing in it is called {names}, but {listed(others)}: say --layer NAME=LABEL")
    notes = (
        [f"labels that no plugin takes, left out: {listed(f'{n} {name}' for name, n in others.items())}"]
        if others
        else []
    )
    rows, counts = dict[str, dict[str, object]](), dict[str, dict[str, int]]()
    for row in dict.fromkeys(one.row for one in known):
        own = [one.structure for one in known if one.row == row]
        rows[row] = {}
        for plugin in plugins:
            mine = [
                replace(thing, label=plugin_of[thing.label.casefold()][1])
                for thing in own
                if plugin_of[thing.label.casefold()][0] == plugin
            ]
            if mine:
                entry = _entry(row, plugin, mine, entry_of)
                rows[row] |= entry.values
                notes += [f"row {row}: {listed([name])} is left out: {why}" for name, why in entry.left_out.items()]
                counts[row] = counts.get(row, {}) | _counted(mine, entry)
    return ImportedSurvey(Survey(rows), counts, tuple(notes))


def _entry(row: str, plugin: str, own: Sequence[Structure], entry_of: EntryHook) -> SurveyEntry:
    far = [thing.id for thing in own if not (np.abs(thing.vertices) <= FARTHEST_M).all()]
    if far:
        raise OutputError(
            f"row {listed([row])}: {listed(far[:1])} is more than {FARTHEST_M:g} m from the row: wrong unit or frame?"
        )
    try:
        return entry_of(plugin, own)
    except OutputError as error:
        raise OutputError(f"row {listed([row])}: {error}") from error


def _counted(own: Sequence[Structure], entry: SurveyEntry) -> dict[str, int]:
    return dict(Counter(thing.label for thing in own if thing.id not in entry.left_out))
