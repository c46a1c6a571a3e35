"""What shines in one view: where lamps are by a network's masks, how far they reach by the picture's brightness."""
