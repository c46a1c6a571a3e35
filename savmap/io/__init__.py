"""Files: reading and writing, whole or not at all."""
