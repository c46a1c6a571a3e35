"""Two maps of one place, made at different times: what both share, and what changed."""
