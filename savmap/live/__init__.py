"""Mapping while one walks: a session takes frames as they come, says what to do better, and maps what it has seen."""
