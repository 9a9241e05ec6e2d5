"""Scripted measurements, each a short file that reads like the laboratory's checklist."""

# For programs of others; the modules that are not named are the package's own.
__all__ = ["calibration", "five_trial", "inflate", "layering", "pressure_sweep", "relaxation", "steps"]
