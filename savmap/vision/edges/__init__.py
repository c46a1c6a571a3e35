"""Straight edges: from masks, and to a small part of a pixel in the panorama."""
