"""What speaks against a row: its footage, how often its structures were seen, and the verdict on its map."""
