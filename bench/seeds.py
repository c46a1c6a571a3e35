"""Seeds of made-up rows and recordings, in three sets.

- `train`: parameters are fitted on them.
- `dev`: every row may be looked at. Faults were mended looking at these.
- `test`: nobody looks at a row; they are printed as totals only. A test seed that was looked at moves to `dev`.

Observation level (masks' edges without pictures) is drawn anew from the seed and has no rows to look at, but its sets are kept apart too.
"""

from collections.abc import Mapping, Sequence

SETS = ("train", "dev", "test")
SEEDS: Mapping[str, Mapping[str, Sequence[int]]] = {
    "rows": {"train": range(1000, 1020), "dev": range(5000, 5020), "test": range(31000, 31020)},
    "grey rows": {"train": range(1000, 1010), "dev": range(5050, 5060), "test": range(32000, 32020)},
    "long rows": {"train": range(1000, 1002), "dev": range(5003, 5004), "test": range(33000, 33003)},
    "signs": {"train": range(6000, 6006), "dev": range(6100, 6106), "test": range(36000, 36006)},
    "observation": {"train": range(3000, 3046), "dev": range(0, 46), "test": range(34000, 34046)},
    "pairs": {"train": range(100, 120), "dev": range(0, 20), "test": range(34100, 34120)},
    "passes": {"train": range(200, 203), "dev": range(20, 22), "test": range(34200, 34202)},
    "recordings": {"train": range(5, 9), "dev": range(1, 5), "test": range(35000, 35004)},
    "deformed rows": {"train": range(8000, 8040), "dev": range(8100, 8104), "test": range(38000, 38040)},
    "dark rows": {"train": range(7001, 7025), "dev": range(7025, 7037), "test": range(37000, 37020)},
}
"""By family. Seeds that stand in the docs or the changelog (1 to 100, 1000s, 3000s to 9300s) are in no test set."""


def seeds(family: str, name: str, count: int | None = None) -> Sequence[int]:
    """The first `count` seeds of a family's set, all by default."""
    return SEEDS[family][name][:count]


def is_test(family: str, seed: int) -> bool:
    """Whether a seed is in the family's test set, so that it may not be shown by itself."""
    return seed in SEEDS[family]["test"]
