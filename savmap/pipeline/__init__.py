"""One row, from video to map."""
