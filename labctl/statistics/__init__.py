"""What trials say together: means, intervals, comparisons, tables."""
