"""What labctl logs by the standard logging, and how it reaches a file or a terminal without waiting for either."""
