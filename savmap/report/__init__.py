"""Pictures and reports of a map."""
