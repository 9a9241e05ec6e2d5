"""Text from outside, safe to show: what could command a terminal is written out instead."""


def printable(text: str, also: str = "") -> str:
    """The text with every character that is not printable written as an escape, save those in `also`.

    An instrument's answer may hold anything: a terminal must never obey it, nor a text change its direction.
    """
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() or one in also else _escape(one) for one in text)


def _escape(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
