"""Scripted measurements, each a short file that reads like the laboratory's checklist."""
