"""Panoramas to measurements: views, edges, markers, flow, networks. Knows no kind of structure."""
