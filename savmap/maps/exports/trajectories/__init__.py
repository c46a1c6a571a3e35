"""Where the camera was, and what it saw, for programs that reconstruct, record and replay."""
