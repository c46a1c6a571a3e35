"""GTSAM factors: of a problem, of shapes, of markers, of followed points, and the checks of a plugin's factors."""
