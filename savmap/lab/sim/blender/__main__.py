"""The command line of `savmap.lab.sim.blender.dataset`."""

from savmap.lab.sim.blender.dataset import main

main()
