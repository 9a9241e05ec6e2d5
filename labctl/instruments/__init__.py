"""What the rig needs of an instrument, whatever its make, and what instruments report."""
