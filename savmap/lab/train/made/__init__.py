"""Training that never ends on pictures that are made meanwhile: `python -m savmap.lab.train.made`."""
