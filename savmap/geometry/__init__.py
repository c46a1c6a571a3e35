"""Cameras and rays, poses, lines and vanishing points: functions on numpy arrays."""
