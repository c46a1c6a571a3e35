"""Fast pictures of racks with exact masks for training: `python -m savmap_shelves.lab.painted --count 100 -o DIR`."""
