"""Parts of the command line: groups of commands, and how it ends."""
