"""What a link leaves out of an instrument's answers, in words for people."""


class Noticed:
    """Each thing once, in the order in which it was first met; `doctor` shows them as notes of the instrument."""

    def __init__(self) -> None:
        self._texts: dict[str, None] = {}

    @property
    def texts(self) -> tuple[str, ...]:
        """What was met so far."""
        return tuple(self._texts)

    def note(self, text: str) -> None:
        """Remember it."""
        self._texts[text] = None

    def echo(self) -> None:
        """The request came back before its answer."""
        self.note("the adapter sends back every request before the answer: the echo is dropped")

    def stray(self, byte: int, where: str) -> None:
        """A byte that belongs to no answer."""
        self.note(f"stray bytes 0x{byte:02X} {where}: dropped")
