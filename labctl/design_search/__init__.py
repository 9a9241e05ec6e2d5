"""The evolution in the laboratory's words: from targets and a sheet to settings, from a run to a design."""
