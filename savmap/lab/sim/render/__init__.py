"""Pictures of a built scene by casting rays."""
