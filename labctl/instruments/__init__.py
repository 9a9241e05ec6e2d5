"""What the rig asks of an instrument, whatever its make, and what instruments answer."""
