"""The command line of `savmap_shelves.lab.painted.pictures`."""

from savmap_shelves.lab.painted.pictures import main

if __name__ == "__main__":
    main()
