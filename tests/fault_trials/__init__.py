"""Faults by the thousand, for tests (a few of each) and for `make bench-faults` (as many as wanted)."""
