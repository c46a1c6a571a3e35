"""The command line of `savmap_lights.simulation.painted.pictures`."""

from savmap_lights.simulation.painted.pictures import main

if __name__ == "__main__":
    main()
