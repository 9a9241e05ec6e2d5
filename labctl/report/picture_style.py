"""What all pictures have in common: letters, names, and how a picture gets into a page."""

import base64
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import Any

import matplotlib
from matplotlib.figure import Figure

# Letters that can still be read in a picture shown at half its size.
_STYLE: Any = {
    "font.size": 16.0,
    "figure.titlesize": 18.0,
    "legend.fontsize": 14.0,
    "svg.hashsalt": "labctl",
}
_DOTS_PER_IN, _MARGIN_IN = 110, 0.1


@contextmanager
def picture_style() -> Iterator[None]:
    """Draw and save pictures in the house's style while inside."""
    with matplotlib.rc_context(_STYLE), warnings.catch_warnings():
        # A letter that the font lacks is drawn as a box; whoever chose the name knows it.
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from", UserWarning)
        yield


def shortened(name: str, longest: int) -> str:
    """A name of at most so many letters: a longer one keeps its beginning and its end, by which names differ."""
    if len(name) <= longest:
        return name
    begins = (longest - 3) * 2 // 5
    return f"{name[:begins]}...{name[begins + 3 - longest :]}"


def picture_uri(figure: Figure) -> str:
    """A figure as the address of a picture that a page holds in itself: the same figure, the same letters.

    What the figure marks as rasterized is so; everything else stays sharp at every size.
    """
    content = BytesIO()
    figure.savefig(
        content,
        format="svg",
        dpi=_DOTS_PER_IN,
        bbox_inches="tight",
        pad_inches=_MARGIN_IN,
        # No date: the same run makes the same page.
        metadata={"Date": None, "Creator": None},
    )
    return f"data:image/svg+xml;base64,{base64.b64encode(content.getvalue()).decode()}"
