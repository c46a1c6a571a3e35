"""The posts of a face: columns are searched for them."""

from itertools import pairwise

import numpy as np

from savmap.types import Bools, Floats
from savmap_shelves.evidence.face_grid import BEYOND, usual_bay
from savmap_shelves.evidence.search.covers import greatest, peaks
from savmap_shelves.evidence.search.face import Face

NEAREST = 0.4
"""How many usual bays a post beyond the end is away, at least."""


def expected_posts(face: Face) -> Floats:
    """x (k, 2) of a face's posts: tracked ones that are not lost, new ones between them, less certain ones in bays so wide that a post is missing, and one
    more at either end if most levels of the outermost bay continue to it."""
    cover = face.post_cover()
    return _with_ends(face, cover, _between(face, cover))


def _between(face: Face, cover: Floats) -> Floats:
    """x (k, 2) of the posts between the first and the last tracked one."""
    posts, settings = face.tracked.posts, face.settings
    kept = posts[greatest(cover, face.x, posts) >= settings.lost]
    posts = kept if len(kept) >= 2 else posts
    inner = (face.x > posts[0, 1]) & (face.x < posts[-1, 0])
    posts = _joined(face, posts, _candidates(face, cover, inner, settings.post))
    for _ in range(2):
        gap, narrowest = np.zeros_like(inner), float(np.diff(posts.mean(axis=1)).min())
        for left, right in pairwise(posts):
            if right.mean() - left.mean() > settings.wide * narrowest:
                gap |= (face.x > left[1]) & (face.x < right[0])
        posts = _joined(face, posts, _candidates(face, cover, gap, settings.post_in_gap))
    return posts


def _with_ends(face: Face, cover: Floats, posts: Floats) -> Floats:
    """Posts, and one more at either end, if most levels of the outermost bay continue to it."""
    for end, beyond in ((-1, face.x > posts[-1, 1]), (0, face.x < posts[0, 0])):
        bay, inner, levels = usual_bay(posts), float(posts[end].mean()), face.tracked.sections[end]
        for centre in _candidates(face, cover, beyond, face.settings.post):
            near = NEAREST * bay < abs(centre - inner) < BEYOND * bay
            if near and len(levels) and _goes_on(face, levels, *sorted((float(centre), inner))):
                posts = _joined(face, posts, np.array([centre]))
                break
    return posts


def _candidates(face: Face, cover: Floats, within: Bools, least: float) -> Floats:
    """x (k,) of the local maxima of the cover, the greatest first."""
    columns = [column for column in peaks(cover, least) if within[column]]
    return np.asarray(face.x[columns])


def _joined(face: Face, posts: Floats, centres: Floats) -> Floats:
    """Posts, and new ones of the usual width at those centres where no post is near."""
    width = face.tracked.width
    apart = max(face.settings.narrow * usual_bay(posts), 2 * width)
    for centre in centres:
        if np.abs(posts.mean(axis=1) - centre).min() > apart:
            posts = np.concatenate([posts, [centre + width * np.array([-0.5, 0.5])]])
    return posts[np.argsort(posts[:, 0])]


def _goes_on(face: Face, levels: Floats, left: float, right: float) -> bool:
    """Whether most of levels (m, 2) show between two places."""
    covered = greatest(face.level_cover((left, right)), face.y, levels) > face.settings.level
    return float(covered.mean()) > 0.5
