"""What `savmap split` takes for a turn, a stop and a structure."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Every number that `savmap split` goes by.

    Sampling: a glance `every_s` seconds, and `closer_s` where passes begin and end; its two pictures at least `apart_s` apart
    and shrunk to `width` pixels.
    Straights: the rig turns slower than `turn_deg_s`; a straight goes on where its direction of travel is the same within
    `bend_deg`. Nearness: what is at right angles passes at `near` or more of the rate of what passes fastest around; gaps of
    up to `gap_s` do not end a pass. Structure: things pass at `aside` or more of the rate of the other side, and their texture
    is `texture` or more of the richer side's. Passes: `least_s` long or more, not counting stops, along the recording's main
    direction or against it within `axis_deg`, and as near as `open_share` of what is usual or nearer.
    """

    every_s: float = 1.0
    closer_s: float = 0.25
    apart_s: float = 0.06
    width: int = 512
    turn_deg_s: float = 8.0
    bend_deg: float = 30.0
    near: float = 0.42
    gap_s: float = 8.0
    aside: float = 0.25
    texture: float = 0.4
    least_s: float = 4.0
    axis_deg: float = 40.0
    open_share: float = 0.35
