"""`savmap plugin new`: a complete project for a new plugin."""

from savmap.plugin.scaffold.new import new_plugin

__all__ = ["new_plugin"]
