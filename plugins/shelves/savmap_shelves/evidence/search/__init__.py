"""The search for posts and levels in the evidence of all frames."""

from savmap_shelves.evidence.search.grid import expected_grid
from savmap_shelves.evidence.search.settings import EvidenceSettings

__all__ = ["EvidenceSettings", "expected_grid"]
