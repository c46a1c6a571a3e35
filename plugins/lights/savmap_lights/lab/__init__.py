"""Made-up lamps: for the simulator, and in painted pictures to train the network on."""
