"""A run of a protocol: its plan, its trials one after the other, pausing, stopping, continuing later."""
