"""Training from nothing on pictures that are made meanwhile, for machines with a graphics card: `python -m
savmap.lab.train.made`."""
