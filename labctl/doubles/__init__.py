"""Byte-level doubles of the instruments, and the plant behind them that really fills, jams and bends."""
