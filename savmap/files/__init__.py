"""Files on disk or at URLs: written whole or not at all, validated with one clear line where they are wrong."""
