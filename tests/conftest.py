"""Tests of an extra are skipped where it is not installed. None depends on how fast the machine is, but that a test which is not marked `slow`
fails where it takes far more of a processor than such a test may.

Beside other workers, none computes with more than one thread of OpenMP (torch): waiting at full speed for one another takes most of their time.
"""

import os
import resource
import tomllib
from collections.abc import Generator
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from packaging.requirements import Requirement

if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")

settings.register_profile("savmap", deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
settings.load_profile("savmap")

LONGEST = (
    "test_docs_run.py",
    "test_dask_executor.py",
    "test_resume.py",
    "test_isolation.py",
    "test_wrong_references.py",
    "test_options.py",
)
"""Files that take longest, by their names: they run first, so that no process is left with one of them at the end."""
EXTRAS = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"][
    "optional-dependencies"
]


MOST_S = 8.0
"""Of a processor, in a test that is not marked `slow`: four times what it should take, for slower and busier machines."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent / "lab" in item.path.parents:
            item.add_marker("lab")
    items.sort(key=lambda item: item.path.name not in LONGEST)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """`@pytest.mark.extra("cad")`: what the test needs beyond the extra `test`."""
    for extra in (name for mark in item.iter_markers("extra") for name in mark.args):
        if not installed(extra):
            pytest.skip(f"the extra `{extra}` is not installed")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Keep the tests that the README names short."""
    began = processor_s()
    result = yield
    used = processor_s() - began
    if used > MOST_S and not any(item.iter_markers("slow")) and not any(item.iter_markers("lab")):
        pytest.fail(f"takes {used:.1f} s of a processor: mark it `slow`, or make it shorter")
    return result


def processor_s() -> float:
    """Of this process and of those that it started and that ended."""
    used = [resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


@cache
def installed(extra: str) -> bool:
    """Whether all packages of an extra are there."""
    return all(_is_there(Requirement(text)) for text in EXTRAS[extra])


def _is_there(requirement: Requirement) -> bool:
    if requirement.name == "savmap":
        return all(map(installed, requirement.extras))
    try:
        distribution(requirement.name)
    except PackageNotFoundError:
        return False
    return True
