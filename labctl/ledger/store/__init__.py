"""The ledger on the disk: a SQLite file and a journal, each of which can make up for the other."""
