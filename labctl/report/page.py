"""What all pages have in common: tables, and a template that is filled in with whatever people wrote escaped."""

from dataclasses import dataclass

from jinja2 import Environment, PackageLoader, StrictUndefined


@dataclass(frozen=True)
class Table:
    """A table: its head, its rows, which rows stand out, and which are there but do not count."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    marked: frozenset[int] = frozenset()
    dimmed: frozenset[int] = frozenset()


def filled_in(template: str, **values: object) -> str:
    """A page of labctl/report/templates; it holds its style in itself."""
    environment = Environment(
        loader=PackageLoader("labctl.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return environment.get_template(template).render(**values)
