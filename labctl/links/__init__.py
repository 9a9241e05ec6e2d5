"""Bytes: serial ports and TCP, with a deadline on every call."""
