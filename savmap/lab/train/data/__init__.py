"""Labelled pictures: savmap's own data sets, COCO and LabelMe."""
