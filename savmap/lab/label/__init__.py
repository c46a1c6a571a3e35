"""Pictures worth labelling, with the network's own masks to start from: `savmap label`. See docs/training.md."""
