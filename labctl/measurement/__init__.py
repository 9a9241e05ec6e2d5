"""From a trial's raw recording to its numbers: the same function live, in `labctl verify` and in a report."""
