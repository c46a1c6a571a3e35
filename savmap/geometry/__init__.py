"""Cameras and rays, poses, lines and vanishing points: numpy only."""
