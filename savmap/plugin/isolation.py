"""Plugins that may fail without harm to the others: after its first failure, a plugin is asked no more and gives
nothing."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, get_origin

from savmap.errors import PluginError, PluginFailedError, SavmapError
from savmap.plugin.apps import notices
from savmap.plugin.calls import Hook
from savmap.plugin.manager import LoadedPlugin

log = logging.getLogger("savmap")
_gathered: ContextVar[list[PluginFailedError] | None] = ContextVar("gathered", default=None)


@dataclass(frozen=True)
class IsolatedPlugin(LoadedPlugin):
    """A plugin at work for one row, or for none in particular, which is asked no more once it failed."""

    row: str = ""
    failures: list[PluginFailedError] = field(default_factory=list, repr=False)

    @property
    def failure(self) -> PluginFailedError | None:
        return self.failures[0] if self.failures else None

    def ask(self, hook: Hook[Any, Any], arguments: Mapping[str, Any]) -> Any:
        """What the plugin answers; nothing, where it failed now or before. What it refuses in its own words is still
        raised, but not where another hook of its own failed meanwhile."""
        if not self.failures:
            try:
                return super().ask(hook, arguments)
            except SavmapError as error:
                if not self.failures:
                    if not isinstance(error, PluginFailedError):
                        raise
                    self._contain(error)
        if hook.default is not None and hook.name != "detect":  # whose default asks the network
            return hook.default(arguments)
        if hook.name == "constrain":
            from savmap.graph import Constraints, image_measurements  # gtsam takes long to import

            return Constraints(self.name, {}, image_measurements([], {}, {}), (), {})
        return (get_origin(hook.expected) or hook.expected)()

    def _contain(self, error: PluginFailedError) -> None:
        self.failures.append(error)
        where = f"row {self.row}: " if self.row else ""
        notices.warning("%s%s", where, left_out(str(error)))
        log.error("%s%s", where, error, exc_info=error)
        gathered = _gathered.get()
        if gathered is not None:
            gathered.append(error)


def left_out(failure: str) -> str:
    """The line about a plugin that failed."""
    return f"{failure}; all else is mapped without it"


def isolated(plugins: Sequence[LoadedPlugin], row: str = "") -> Sequence[LoadedPlugin]:
    """The same plugins, each kept from harming the others."""
    return [IsolatedPlugin(**vars(plugin), row=row) for plugin in plugins]


def failed(plugins: Sequence[LoadedPlugin]) -> dict[str, str]:
    """By plugin: how it failed, if it did."""
    return {plugin.name: str(plugin.failure) for plugin in plugins if plugin.failure is not None}


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
