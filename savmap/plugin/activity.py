"""The hook that is at work in this process, for a supervisor that must name it when the process dies or hangs."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Sink = Callable[[str, str], None]
IDLE = ("", "")
_sink: Sink | None = None
_current: ContextVar[tuple[str, str]] = ContextVar("current", default=IDLE)


def set_sink(sink: Sink | None) -> None:
    """Report the calls of hooks in this process to `sink(plugin, hook)`; None: to nobody.

    It is called when a hook begins, and with two empty strings when it ends. When a hook that another one asked for
    ends (`detect` within `render_views`), it is called with the outer one, which is at work again.
    """
    global _sink
    _sink = sink


@contextmanager
def at_work(plugin: str, hook: str) -> Iterator[None]:
    """Report that a plugin's hook is at work while this lasts."""
    token = _current.set((plugin, hook))
    _report()
    try:
        yield
    finally:
        _current.reset(token)
        _report()


def _report() -> None:
    if _sink is not None:
        _sink(*_current.get())
