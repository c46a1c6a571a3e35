"""Apps that come with savmap. Each names what it brings in an `App` (`savmap.plugin.apps`)."""
