"""A trial's raw recordings: Parquet files, whole or not there."""
