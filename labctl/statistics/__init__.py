"""What trials give together: means, intervals, comparisons, tables."""
