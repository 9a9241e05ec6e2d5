"""A path on the command line that must be named."""

import os
from pathlib import Path

import click


class NonEmptyPath(click.Path):
    """A path; '', as a shell leaves of a variable that is not set, is refused instead of being this folder."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str | bytes | os.PathLike[str]:
        """As `click.Path`."""
        if value == "":
            self.fail("it is empty: write a name, or . for this folder", param, ctx)
        return super().convert(value, param, ctx)
