"""Surveys out of tables (CSV) and drawings (DXF)."""
