"""Where cameras are: the cart's drive, its true passes, random views."""
