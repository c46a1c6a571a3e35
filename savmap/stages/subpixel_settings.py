"""Parameters of the measurement of edges in panoramas."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Subpixel:
    """Settings; pixels of the view unless they say panorama.

    - `reach_px`: how far from the mask's edge to look; `prior_px`: how far off the mask's edge usually is (sigma),
      and `flanked_bias_px`: how far too far outside if it is flanked.
    - `piece_px`: least and greatest length of a piece; `end_trim_px`: what is left out at either end.
    - `least_contrast`: changes of less grey levels a panorama pixel are none; `full_contrast`: stronger ones count alike.
    - `least_support`: support that the chosen line must have, of 1, and `clear`: how many times that of any other line.
    - `least_share`, `least_pieces`: share and number of the pieces that must agree with it.
    - `inner`: share of the best line's support that a line further inside needs to be taken for the front's edge, and how
      far inside it may be, as a share of the thing's thickness; `patterned_inner`: of things with a pattern.
    - `depth`: how deep things are, as a multiple of their thickness; flanks that appear wider than `resolved` panorama
      pixels are told from the front; narrow ones blur the edge by `unresolved` of their width.
    - `common_sigma`: what all pieces of an edge may be off together, panorama pixels; `patterned_sigma_px`: the same of
      flanked edges of things with a pattern, which may have lines beside their edges.
    - `mask_sigma_px`, `flanked_sigma_px`: the same of edges that are left as masks have them.
    """

    reach_px: float = 3.0
    prior_px: float = 1.2
    flanked_bias_px: float = 0.5
    piece_px: tuple[float, float] = (2.0, 6.0)
    end_trim_px: float = 3.0
    least_contrast: float = 1.5
    full_contrast: float = 12.0
    least_support: float = 0.15
    clear: float = 1.6
    least_share: float = 0.3
    least_pieces: int = 4
    inner: tuple[float, float] = (0.3, 0.4)
    patterned_inner: tuple[float, float] = (0.5, 0.2)
    depth: float = 1.0
    resolved: float = 0.6
    unresolved: float = 0.8
    common_sigma: float = 0.1
    patterned_sigma_px: float = 0.7
    mask_sigma_px: float = 0.4
    flanked_sigma_px: float = 1.2
