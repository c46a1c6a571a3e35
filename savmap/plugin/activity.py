"""Which plugin's hook is at work in this process, for whoever watches over it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Sink = Callable[[str, str], None]
_sinks: list[Sink] = []


def set_sink(sink: Sink | None) -> None:
    """Have `sink(plugin, hook)` called when a hook begins, and `sink("", "")` when it ends; None: nobody is told."""
    _sinks[:] = [sink] if sink is not None else []


@contextmanager
def working(plugin: str, hook: str) -> Iterator[None]:
    """While this lasts, the plugin's hook is at work."""
    for sink in _sinks:
        sink(plugin, hook)
    try:
        yield
    finally:
        for sink in _sinks:
            sink("", "")
