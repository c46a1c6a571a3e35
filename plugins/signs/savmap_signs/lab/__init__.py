"""Signs for the simulator and for training pictures."""
