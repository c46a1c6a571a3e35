"""A hook as a typed method: one plugin is asked, its answer is checked, and a failure names plugin and hook."""

import faulthandler
import inspect
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, ParamSpec, TypeVar, get_args, get_origin

import pluggy

from savmap.errors import PluginFailedError, SavmapError, format_error
from savmap.plugin import hookspecs, trace
from savmap.plugin.protocol import implements
from savmap.types import View

P = ParamSpec("P")
Answer = TypeVar("Answer")
manager = pluggy.PluginManager("savmap")
"""Of all plugins. It knows the hooks and registers no plugin: a run has a plugin many times, with other settings."""
manager.add_hookspecs(hookspecs)


class _HookLimit:
    """Ends this process, with a traceback, when the hooks that run are stuck: none began or ended for too long."""

    def __init__(self) -> None:
        self.seconds = float("inf")
        self._running, self._lock = 0, threading.Lock()

    def __enter__(self) -> None:
        self._count(1)

    def __exit__(self, *_: object) -> None:
        self._count(-1)

    def _count(self, more: int) -> None:
        if self.seconds < threading.TIMEOUT_MAX:
            with self._lock:
                self._running += more
                if self._running:
                    faulthandler.dump_traceback_later(self.seconds, exit=True)
                else:
                    faulthandler.cancel_dump_traceback_later()


_hook_limit = _HookLimit()


def limit_hooks(seconds: float) -> None:
    """End this process when a hook takes longer than that."""
    _hook_limit.seconds = seconds


class Hook(Generic[P, Answer]):
    """A method of a `HookCaller` that asks its plugin one hook, with the types of the hook's specification.

    `expected` is the type of the answer, such as `ViewPlan` or `list[Track]`. `check` takes the answer and, by name,
    any of the hook's arguments or of the caller's attributes, and raises ValueError with the first fault. `default`
    answers, by the hook's arguments, for a plugin that leaves the hook out or gives None; without it an answer is
    required.
    """

    def __init__(
        self,
        spec: Callable[P, Answer],
        expected: Any,
        check: Callable[..., object] = lambda _: None,
        default: Callable[[Mapping[str, Any]], Answer] | None = None,
    ) -> None:
        self.name, self.signature = spec.__name__, inspect.signature(spec)
        self.expected, self.check, self.default = expected, check, default
        self.checked_with = list(inspect.signature(check).parameters)[1:]

    def __get__(self, caller: "HookCaller", owner: type) -> Callable[P, Answer]:
        return partial(self, caller)

    def __call__(self, caller: "HookCaller", *args: P.args, **kwargs: P.kwargs) -> Answer:
        """What the caller's plugin answers. Raises PluginFailedError, or the plugin's SavmapError."""
        answer: Answer = caller.ask(self, self.signature.bind(*args, **kwargs).arguments)
        return answer

    def type_fault(self, answer: Any) -> str:
        """How an answer is of another type than the hook may give; empty where it is not."""
        sequence = get_origin(self.expected) in (list, tuple)
        kind = get_origin(self.expected) if sequence else self.expected
        if not isinstance(answer, kind):
            return f"{type(answer).__name__} from `{self.name}`, not {next(iter(get_args(kind)), kind).__name__}"
        item_kind = get_args(self.expected)[0] if sequence else object
        for item in answer if sequence else ():
            if not isinstance(item, item_kind):
                given = f"a {type(answer).__name__} with a {type(item).__name__}"
                return f"{given} from `{self.name}`, not {item_kind.__name__}"
        return ""


@dataclass(frozen=True)
class HookCaller:
    """One plugin that is asked hooks.

    Each hook is a method with the arguments of its specification. All of them raise PluginFailedError, with the
    plugin's and the hook's name, where the hook raises or ends the program or its answer cannot be used. A SavmapError
    of the plugin, with which it refuses in its own words, is raised as it is.
    """

    name: str
    instance: Any

    def has(self, hook: str) -> bool:
        """Whether the plugin writes a hook itself, so that no default answers."""
        return implements(self.instance, hook)

    def ask(self, hook: Hook[Any, Any], arguments: Mapping[str, Any]) -> Any:
        """What the plugin answers to a hook, when it is of the expected type and passes the check."""
        view = arguments.get("view")
        where = f"`{hook.name}`" + (f" at frame {view.frame} of {view.spec.name}" if isinstance(view, View) else "")
        try:
            with _hook_limit, trace.call(f"{self.name}.{hook.name}", arguments) as outcome:
                methods = [getattr(self.instance, hook.name)] if self.has(hook.name) else []
                answer = getattr(manager.hook, hook.name).call_extra(methods, arguments)
                if answer is None and hook.default is not None:
                    answer = hook.default(arguments)
                outcome["answer"] = answer
        except SavmapError:
            raise
        except (Exception, SystemExit) as error:
            raise PluginFailedError(self.name, hook.name, f"failed in {where}: {format_error(error)}") from error
        if fault := hook.type_fault(answer):
            raise PluginFailedError(self.name, hook.name, f"returned {fault}")
        try:
            named = {name: arguments[name] if name in arguments else getattr(self, name) for name in hook.checked_with}
            hook.check(answer, **named)
        except PluginFailedError:
            raise
        except Exception as error:
            reason = str(error) if type(error) is ValueError else format_error(error)
            what = f"returned what cannot be used from {where}: {reason}"
            raise PluginFailedError(self.name, hook.name, what) from error
        return answer
