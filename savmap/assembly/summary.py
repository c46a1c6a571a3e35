"""A site's assembly as a table: where rows stand, and how well their matches agree."""

from collections.abc import Iterator, Sequence

import numpy as np

from savmap.types import CrossRowMatch, Floats, SiteMap


def site_lines(site: SiteMap) -> Iterator[str]:
    """Lines of rows' placements, then of the matches of every two rows by kind: how many, and how far their two places
    are apart, cm. None where no row is placed."""
    if not site.placements:
        return
    wide = 2 * max(map(len, site.placements)) + 4
    yield f"{'row':>{wide}}{'x m':>10}{'z m':>10}{'heading':>10}{'sigma: x, z cm':>16}{'deg':>7}"
    for name, placement in site.placements.items():
        x, z, turn = np.sqrt(np.diag(placement.covariance))
        pose = (placement.x_m, placement.z_m, placement.heading_deg)
        where = "".join(f"{round(value, 3) + 0.0:10.3f}" for value in pose)
        yield f"{name:>{wide}}{where}{100 * x:10.1f}{100 * z:6.1f}{turn:7.3f}"
    left = [name for name in site.rows if name not in site.placements]
    if left:
        yield f"not placed: {', '.join(left)} (they have no given place, and nothing in common with a row that has one)"
    if site.matches:
        yield f"{'rows':>{wide}}  {'in common':<16}{'n':>4}{'x':>8}{'y':>8}{'z':>8}{'largest':>9}   apart, cm (rms); sigmas"
        for (a, b, kind), matches in matches_by_kind(site.matches).items():
            yield f"{a + ', ' + b:>{wide}}  {kind:<16}{len(matches):4d}{_figures(matches)}"


def matches_by_kind(matches: Sequence[CrossRowMatch]) -> dict[tuple[str, str, str], list[CrossRowMatch]]:
    """Matches by their two rows and by the kind of what these have in common."""
    groups: dict[tuple[str, str, str], list[CrossRowMatch]] = {}
    for match in matches:
        kind = " ".join(word for word in match.id_a.split() if word.isalpha())
        groups.setdefault((match.row_a, match.row_b, kind), []).append(match)
    return groups


def _figures(matches: Sequence[CrossRowMatch]) -> str:
    residuals = np.array([match.residual_m for match in matches])
    sigmas = np.abs(residuals / np.array([match.sigma_m for match in matches]))
    return "".join(map(_cell, residuals.T)) + f"{np.nanmax(sigmas):9.1f}"


def _cell(residuals: Floats) -> str:
    measured = residuals[~np.isnan(residuals)]
    return f"{100 * float(np.sqrt(np.mean(measured**2))):8.1f}" if len(measured) else f"{'-':>8}"
