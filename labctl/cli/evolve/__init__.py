"""`labctl evolve` and its sub-commands."""
