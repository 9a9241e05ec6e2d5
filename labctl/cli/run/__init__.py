"""`labctl run`, and the words to a run that goes on."""
