"""Made-up pictures of ceilings, for training the network."""
