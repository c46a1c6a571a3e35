"""A site's assembly for people: where rows stand, and what is left between them."""

from collections.abc import Iterator

import numpy as np

from savmap.types import CrossRowMatch, Floats, SiteMap


def site_lines(site: SiteMap) -> Iterator[str]:
    """Rows' places, then what ties every two rows: how many things, and how far their two places are apart, cm. Nothing where
    no row is placed."""
    if not site.placements:
        return
    wide = 2 * max(map(len, site.placements)) + 4
    yield f"{'row':>{wide}}{'x m':>10}{'z m':>10}{'heading':>10}{'sigma: x, z cm':>16}{'deg':>7}"
    for name, place in site.placements.items():
        x, z, turn = np.sqrt(np.diag(place.covariance))
        where = "".join(f"{round(value, 3) + 0.0:10.3f}" for value in (place.x_m, place.z_m, place.heading_deg))
        yield f"{name:>{wide}}{where}{100 * x:10.1f}{100 * z:6.1f}{turn:7.3f}"
    left = [name for name in site.rows if name not in site.placements]
    if left:
        yield f"not placed: {', '.join(left)} (no place was given, and nothing ties them to a row that has one)"
    if site.matches:
        yield f"{'rows':>{wide}}  {'tied by':<16}{'n':>4}{'x':>8}{'y':>8}{'z':>8}{'largest':>9}   apart, cm (rms); sigmas"
        for (a, b, kind), ties in grouped(site.matches).items():
            yield f"{a + ', ' + b:>{wide}}  {kind:<16}{len(ties):4d}{_figures(ties)}"


def grouped(ties: tuple[CrossRowMatch, ...]) -> dict[tuple[str, str, str], list[CrossRowMatch]]:
    """Ties by their two rows and by what they are."""
    groups: dict[tuple[str, str, str], list[CrossRowMatch]] = {}
    for tie in ties:
        kind = " ".join(word for word in tie.id_a.split() if word.isalpha())
        groups.setdefault((tie.row_a, tie.row_b, kind), []).append(tie)
    return groups


def _figures(ties: list[CrossRowMatch]) -> str:
    off = np.array([tie.residual_m for tie in ties])
    normal = np.abs(off / np.array([tie.sigma_m for tie in ties]))
    return "".join(map(_cell, off.T)) + f"{np.nanmax(normal):9.1f}"


def _cell(off: Floats) -> str:
    told = off[~np.isnan(off)]
    return f"{100 * float(np.sqrt(np.mean(told**2))):8.1f}" if len(told) else f"{'-':>8}"
