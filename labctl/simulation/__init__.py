"""The one joint between the laboratory's files and `sim`."""
