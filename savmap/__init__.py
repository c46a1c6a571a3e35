"""savmap: metric, semantic wireframe maps of structured places from panoramic video."""
