"""The command line of `savmap.sim.blender.dataset`."""

from savmap.sim.blender.dataset import main

main()
