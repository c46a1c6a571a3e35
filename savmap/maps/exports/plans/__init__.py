"""Formats of plans of the floor: what stands there, and where one can drive. For robots, their fleets, and indoor maps.

All of them stand in the world's frame, seen from above: metres, x and y.
"""
