"""Thresholds of the search in a face's evidence."""

from dataclasses import dataclass


@dataclass(frozen=True)
class EvidenceSettings:
    """Thresholds of the evidence.

    The cover of a post or level is the share of its length along which the evidence exceeds that of its surroundings by `clear` times the
    usual strength of the tracked ones, or by `faint`. A faint object along the whole length has full cover. A strong but shorter one has not.

    - `post`, `level`: least cover of a new post or level. `post_in_gap`: that of a post in a bay so wide that one is missing.
    - `lacking`: that of a new level where its bay lacks a lowest one where the others have theirs.
    - `partly`: that of a new level as high as the others' highest ones, or in a step that is too wide; and of a stripe that tells where a bay's lowest level
      is, below hidden feet. `between`: that in such a step where its colours do not tell of a level in pieces.
    - `lost`: a tracked post or level with less cover is dropped.
    - `faint`: the least strength that counts as usual, and the least that anything stands out by.
    - `wide`: a bay of this multiple of the narrowest one may lack a post. `narrow`: posts nearer than this share of a bay are one.

    Similarity is that of paint, 1 for the paint of beams, 0 for the rest of the face. It counts where paint is informative (`Paint.is_informative`).

    - `strange`: below this similarity there is no level.
    - `doubted`: below this one there is none, unless it has cover along the whole length, or cover times strength above `plain`. Where paint is
      not informative, a new level needs one of the two.
    - `painted`: the cover, in its own bay or in half of the bays, that suffices for a level with the paint of the beams. What has less than
      a quarter of it is not looked at.

    Nor does paint count where the network is sure of a tracked level along the whole length: the lowest beams stand in the shade.
    """

    clear: float = 0.2
    post: float = 0.7
    post_in_gap: float = 0.45
    level: float = 0.8
    lacking: float = 0.3
    partly: float = 0.4
    between: float = 0.2
    lost: float = 0.1
    faint: float = 0.05
    wide: float = 1.6
    narrow: float = 0.3
    strange: float = 0.3
    doubted: float = 0.6
    plain: float = 0.3
    painted: float = 0.4
