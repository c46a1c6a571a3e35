"""The command line of `savmap_shelves.simulation.painted.pictures`."""

from savmap_shelves.simulation.painted.pictures import main

if __name__ == "__main__":
    main()
