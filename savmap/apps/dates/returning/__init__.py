"""Coming back to a mapped row: where along it a pass is, and the map with what the pass shows."""
