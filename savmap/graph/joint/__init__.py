"""Several rows in one graph, where they share frames."""
