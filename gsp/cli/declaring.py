"""Commands about the models that there are: `gsp models`, `gsp import`."""

from __future__ import annotations

from pathlib import Path

import click

from gsp.cli.asking import json_option, keep_model, output_option
from gsp.cli.program import cli
from gsp.cli.telling import print_json, tell, wrote
from gsp.errors import DeclarationError, GspError
from gsp.results.files import write_file


@cli.command()
@json_option
def models(as_json: bool) -> None:
    """List the built-in scenes."""
    from gsp.models import summary

    rows = summary()
    if as_json:
        print_json([{"name": name, "title": title} for name, title in rows])
        return
    width = max(len(name) for name, _ in rows)
    for name, title in rows:
        click.echo(f"{name:{width}}  {title}")


@cli.command("import")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--small", metavar="NAME", help="The parameter that is the small one [epsilon or eps].")
@output_option("File for the model [FILE with the suffix .toml].")
@click.option("--force", is_flag=True, help="Write over a file that is there.")
def import_(file: Path, small: str | None, output: Path | None, force: bool) -> None:
    """Read FILE and write it as a model file. Say what was understood, and what was left out.

    FILE is an .ode file of XPPAUT, SBML (.xml, .sbml) or Antimony (.ant).
    """
    from gsp.readers.loading import FORMATS, import_model

    if output is not None and output.suffix.lower() in FORMATS:
        raise DeclarationError(
            f"a file that ends in {output.suffix} is not read as a model file.",
            "Give a name in .toml.",
            got=output,
        )
    keep_model(str(file), output)
    found = import_model(file, small=small)
    target = output or file.with_suffix(".toml")
    if target.exists() and not force:
        raise GspError(
            f"there is a file {target} already.", "Name another with -o, or write over it with --force."
        )
    write_file(found.text.encode(), target)
    wrote(target)
    for note in found.notes:
        tell(note)
    click.echo(f"model: {target}")
