"""A trial's raw recordings: Parquet files, each complete or not there."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
