"""Runs, trials, events and raw samples, committed before they are reported."""
