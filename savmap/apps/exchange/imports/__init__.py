"""Surveys out of tables (CSV), drawings (DXF) and building models (IFC)."""
