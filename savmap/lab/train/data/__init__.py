"""Labelled pictures: savmap's own data sets, COCO, YOLO segments and LabelMe."""
