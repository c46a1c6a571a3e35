"""Racks for the simulator, and what masks of them would show."""
