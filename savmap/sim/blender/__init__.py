"""Path-traced training pictures with Blender: `python -m savmap.sim.blender`. See docs/training-pictures.md."""
