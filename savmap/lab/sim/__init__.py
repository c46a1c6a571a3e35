"""Made-up places: scenes to panoramas, masks and truth, and scenes to noisy observations."""
