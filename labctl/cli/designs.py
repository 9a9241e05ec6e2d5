"""`labctl designs`: the designs that ship with labctl, and the text of one, to begin a design file of one's own."""

import click

from labctl.cli.options import json_option
from labctl.cli.output import emit_json, table


@click.command()
@click.argument("name", required=False)
@json_option
def designs(name: str | None, as_json: bool) -> None:
    """List the designs that ship with labctl; with a NAME, print that design's file.

    To begin one of your own: labctl designs known > mine.toml, then --design ./mine.toml.
    """
    from labctl.config.load import design_text, load_design, shipped_designs

    if name is not None:
        text = design_text(name)
        if as_json:
            emit_json({"design": name, "text": text})
        else:
            click.echo(text, nl=not text.endswith("\n"))
        return
    shipped = [load_design(each) for each in shipped_designs()]
    if as_json:
        emit_json(
            {
                "designs": [
                    {"name": each.name, "fibers": len(each.fibers), "patterns": sorted(each.patterns)}
                    for each in shipped
                ]
            }
        )
        return
    table(
        ("design", "fibers", "patterns"),
        [(each.name, str(len(each.fibers)), ", ".join(sorted(each.patterns))) for each in shipped],
    )
