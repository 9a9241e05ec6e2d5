"""From targets and a sheet to the settings of a search, from a run of it to a design file."""
