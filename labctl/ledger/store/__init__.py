"""The ledger on the disk: a SQLite file and a journal, each of which can make up for the other."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
