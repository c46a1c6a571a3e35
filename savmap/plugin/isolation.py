"""Rooms whose plugin may fail without harm to the others: from then on they answer that there is nothing."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from savmap.errors import PluginError, PluginFailedError, SavmapError
from savmap.plugin.manager import LoadedPlugin
from savmap.types import Structure

if TYPE_CHECKING:
    from savmap.graph import Constraints

log = logging.getLogger("savmap")
told = logging.getLogger("savmap-plugins")
_gathered: ContextVar[list[PluginFailedError] | None] = ContextVar("gathered", default=None)


@dataclass(frozen=True)
class IsolatedPlugin(LoadedPlugin):
    """A room for one row, or for none in particular, whose plugin is asked no more once it failed."""

    row: str = ""
    failures: list[PluginFailedError] = field(default_factory=list, repr=False)

    @property
    def failure(self) -> PluginFailedError | None:
        return self.failures[0] if self.failures else None

    def ask(self, hook: str, expected: type, item: type | None = None, **arguments: Any) -> Any:
        """What the plugin answers; nothing, where it failed now or before. What it refuses in its own words is still raised, but not
        where another hook of its own failed meanwhile."""
        if not self.failures:
            try:
                return super().ask(hook, expected, item, **arguments)
            except PluginFailedError as error:
                if not self.failures:
                    self._failed(error)
            except SavmapError:
                if not self.failures:
                    raise
        return nothing(expected, self.name)

    def constrain(self, **arguments: Any) -> "Constraints":
        """The plugin's constraints; none, where these are not valid."""
        from savmap.graph import Constraints

        try:
            return super().constrain(**arguments)
        except PluginFailedError as error:
            self._failed(error)
            none: Constraints = nothing(Constraints, self.name)
            return none

    def relate(
        self, structures: Sequence[Structure], others: Mapping[str, Sequence[Structure]]
    ) -> tuple[Structure, ...]:
        """The structures as they were described, where the plugin cannot say how they stand to others."""
        related = super().relate(structures, others)
        return related if self.failure is None else tuple(structures)

    def _failed(self, error: PluginFailedError) -> None:
        self.failures.append(error)
        where = f"row {self.row}: " if self.row else ""
        told.warning("%s%s", where, left_out(str(error)))
        log.error("%s%s", where, error, exc_info=error)
        gathered = _gathered.get()
        if gathered is not None:
            gathered.append(error)


def left_out(failure: str) -> str:
    """The line about a plugin that failed."""
    return f"{failure}; all else is mapped without it"


def isolated(
    rooms: Sequence[LoadedPlugin], row: str = "", failed: Mapping[str, PluginFailedError] | None = None
) -> Sequence[LoadedPlugin]:
    """The same plugins, each kept from harming the others. `failed`: by plugin, how it failed in this row already."""
    known = failed or {}
    return [
        IsolatedPlugin(
            **{own.name: getattr(room, own.name) for own in fields(room)},
            row=row,
            failures=[known[room.name]] if room.name in known else [],
        )
        for room in rooms
    ]


def failed(rooms: Sequence[LoadedPlugin]) -> dict[str, str]:
    """By room: how its plugin failed, if it did."""
    return {room.name: str(room.failure) for room in rooms if room.failure is not None}


@contextmanager
def failures_gathered() -> Iterator[list[PluginFailedError]]:
    """The failures that are contained, in this process, while this lasts."""
    gathered: list[PluginFailedError] = []
    token = _gathered.set(gathered)
    try:
        yield gathered
    finally:
        _gathered.reset(token)


def because(error: SavmapError, failures: Mapping[str, str]) -> SavmapError:
    """Why a row could not be mapped: for want of the plugins that failed, if any did."""
    if not failures:
        return error
    return PluginError(f"{'; '.join(failures.values())}; without it the row cannot be mapped: {error}")


def nothing(expected: type, room: str) -> Any:
    """The answer of a hook that says there is nothing."""
    from savmap.graph import Constraints, image_measurements
    from savmap.types import ViewPlan

    if expected is Constraints:
        return Constraints(room, {}, image_measurements([], {}, {}), (), {})
    return ViewPlan(()) if expected is ViewPlan else expected()
