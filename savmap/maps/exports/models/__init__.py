"""Formats of models: glTF and USD for what shows and simulates, IFC for buildings, DXF for drawings."""
