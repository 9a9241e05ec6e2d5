"""Pictures of a simulated sheet."""
