"""Where cameras are: the cart's drive, its true passes, the camera's optics, random views."""
