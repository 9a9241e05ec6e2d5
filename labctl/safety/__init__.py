"""SAFE as a state that is read back, the supervisor that enforces the limits, the guard that outlives the program."""
