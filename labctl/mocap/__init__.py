"""From marker frames to heights of the sheet."""
