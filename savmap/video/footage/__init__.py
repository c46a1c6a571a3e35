"""What footage is, and how the camera went, from small pictures of it."""
