"""Target shapes: what a sheet's heights are scored against."""
