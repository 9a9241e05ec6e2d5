"""A trial's raw recordings: Parquet files, each complete or not there."""
