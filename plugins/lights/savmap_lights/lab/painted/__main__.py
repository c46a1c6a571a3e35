"""The command line of `savmap_lights.lab.painted.pictures`."""

from savmap_lights.lab.painted.pictures import main

if __name__ == "__main__":
    main()
