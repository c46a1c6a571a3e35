"""Unknowns of the camera: stitching and read-out of its panoramas."""
