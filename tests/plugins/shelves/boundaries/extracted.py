"""What is extracted of drawn racks' masks, and how far off it is."""

from rack_pictures import Camera, Image, Picture, Rack

from savmap.types import Feature
from savmap.vision.networks.segmenter import regions
from savmap_shelves.boundaries import extract_features

FACING = Camera(x=1.3, y=2.1, z=1.6, hfov=118.0)
CAMERAS = {
    "facing": FACING,
    "wide": Camera(x=0.6, y=2.0, z=1.0, hfov=150.0),
    "narrow": Camera(x=1.3, y=2.1, z=3.4, hfov=80.0),
    "turned": Camera(x=1.5, y=2.2, z=1.5, hfov=122.0, yaw=5.0, pitch=-3.0, roll=3.0),
    "steep": Camera(x=1.0, y=2.0, z=0.75, hfov=155.0, yaw=-4.0, pitch=2.0, roll=-2.0),
}
LEVELS = {
    "few": Rack(),
    "many": Rack(beams=[(0.1 + 0.37 * i, 0.18 + 0.37 * i) for i in range(11)]),
}


def found(picture: Picture, upright: Image | None = None, beam: Image | None = None) -> list[Feature]:
    upright = picture.uprights if upright is None else upright
    beam = picture.beams if beam is None else beam
    features = everything(picture, upright, beam)
    return [feature for feature in features if feature.part != "foot"]


def everything(picture: Picture, upright: Image, beam: Image) -> list[Feature]:
    return extract_features(picture.view, [*regions("upright", upright, 0.5, 30), *regions("beam", beam, 0.5, 30)])


def of(features: list[Feature], label: str, part: str) -> list[Feature]:
    return [feature for feature in features if (feature.label, feature.part) == (label, part)]


def worst(picture: Picture, features: list[Feature]) -> float:
    assert features
    return max(picture.edge_error(feature) for feature in features)


def counts(features: list[Feature]) -> tuple[int, int, int]:
    """Uprights, beams, corners."""
    corners = sum(len(feature.pixels) == 1 for feature in features)
    return len(of(features, "upright", "left")), len(of(features, "beam", "lower")), corners


def without(image: Image, rows: slice, columns: slice) -> Image:
    changed = image.copy()
    changed[rows, columns] = 0
    return changed


def columns_of(picture: Picture, x: tuple[float, float], margin: int = 3) -> slice:
    low, high = sorted(int(picture.camera.pixels(at, 2.0)[0]) for at in x)
    return slice(max(low - margin, 0), high + margin + 1)
