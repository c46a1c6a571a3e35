"""Files on disk or at URLs: written whole or not at all, and validated."""
