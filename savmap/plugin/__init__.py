"""The door for plugins: hooks, their manager, isolation of failures, contract tests, scaffold."""
