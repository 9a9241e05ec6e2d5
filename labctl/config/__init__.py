"""Configuration files in, frozen dataclasses out."""
