"""Many rows: scheduler, tasks, executors, cache."""
