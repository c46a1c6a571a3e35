"""The engine's stages between panoramas and tracks: generic, knowing no kind of structure."""
