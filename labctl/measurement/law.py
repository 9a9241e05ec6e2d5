"""The laws by which heights are made of marker frames; a result names the one it was made by.

A law is kept as long as ledgers hold results of it, so that they are verified by their own.
"""

PLAIN_MEANS = 1
"""Every frame that shows a marker counts; the frame is fitted to all markers."""

GATED_MEANS = 2
"""Single frames far from the median are left out; a marker that jumped or changed places is not seen."""

NEWEST = GATED_MEANS
"""What a new result is made by."""

KNOWN = (PLAIN_MEANS, GATED_MEANS)
"""Those that this program can derive by."""
