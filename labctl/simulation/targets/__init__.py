"""Target shapes as people name them, and a simulated sheet's score against one."""
