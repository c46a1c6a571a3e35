"""Where the solve starts."""
