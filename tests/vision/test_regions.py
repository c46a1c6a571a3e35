"""Connected regions: numbered in scan order, over corners too, the same with and without their boxes and areas."""

import numpy as np
from scipy.ndimage import label

from savmap.vision.regions import connected_regions, region_labels


def blobs() -> np.ndarray:
    mask = np.zeros((12, 20), np.uint8)
    mask[6:9, 1:4] = 1
    mask[1:3, 10:14] = 255
    mask[3, 14] = 1
    return mask


def test_regions_have_labels_boxes_and_areas() -> None:
    regions = connected_regions(blobs())
    assert regions.labels[1, 10] == regions.labels[3, 14] == 1
    assert regions.labels[6, 1] == 2
    assert regions.boxes[1:].tolist() == [[10, 1, 5, 3], [1, 6, 3, 3]]
    assert regions.areas.tolist() == [240 - 18, 9, 9]


def test_labels_alone_are_the_same() -> None:
    mask = (np.random.default_rng(3).random((90, 70)) > 0.6).astype(np.uint8)
    labels = region_labels(mask)
    np.testing.assert_array_equal(labels, connected_regions(mask).labels)
    assert labels.max() == label(mask, np.ones((3, 3)))[1]
