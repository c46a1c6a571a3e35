"""Path-traced training pictures with Blender: `python -m savmap.lab.sim.blender`. See docs/training-pictures.md."""
