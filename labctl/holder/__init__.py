"""Who holds a rig: found by the rig's addresses, wherever its program was started, and reached at once."""
