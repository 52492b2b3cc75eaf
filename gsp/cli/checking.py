"""Commands that check: `gsp check`, `gsp verify`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from gsp.cli.asking import asks, json_option, output_option
from gsp.cli.program import cli
from gsp.cli.telling import print_json, progress_bar
from gsp.errors import DeclarationError, GspError

if TYPE_CHECKING:
    from gsp.scenes.scene import Scene


@cli.command()
@asks("set", "epsilon", "region", "small", "fast")
@click.option("--prove", is_flag=True, help="Prove it in ball arithmetic instead of sampling.")
@output_option("Write the proof to this file; `gsp verify` checks it.")
@json_option
def check(scene: Scene, prove: bool, output: Path | None, as_json: bool) -> None:
    """Check the conditions of normal hyperbolicity of MODEL over its region.

    Exit status 0 when every condition holds at the samples, 1 when one fails; with --prove 0 when it is proved, 1
    when it is refuted, 3 when it is undecided.
    """
    from gsp.scenes.study import study_of

    if output is not None and not prove:
        raise DeclarationError("-o writes a proof, and samples are none.", "Add --prove, or leave -o out.")
    study = study_of(scene)
    if prove:
        from gsp.slow_tubes.certify import certify

        with progress_bar("boxes") as advance:
            certificate = certify(study.branch, region=study.region, epsilon=scene.epsilon, progress=advance)
            if output is not None and certificate.verdict.name == "PROVED":
                certificate.save(output)
        if as_json:
            print_json({"name": scene.name, **certificate.as_dict()})
        else:
            click.echo(str(certificate))
        click.get_current_context().exit({"PROVED": 0, "REFUTED": 1, "UNDECIDED": 3}[certificate.verdict.name])
    verdict = study.hyperbolicity
    if as_json:
        from gsp.report import hyperbolicity_as_json

        print_json({"name": scene.name, "holds": verdict.holds, **hyperbolicity_as_json(verdict)})
    else:
        click.echo(str(verdict))
    fails = not all(condition.holds for condition in verdict.conditions)
    click.get_current_context().exit(0 if verdict.holds else 1 if fails else 3)


@cli.command()
@click.argument("file", type=click.Path(path_type=Path))
@json_option
def verify(file: Path, as_json: bool) -> None:
    """Check the proof in FILE, which `gsp check --prove -o FILE` wrote: in whole numbers, by code of its own.

    The file of a tube about a slow manifold, which its `save` writes, is checked as well.

    Exit status 0 when the proof holds, 1 when it does not.
    """
    from gsp.proofs.programs import Rejected
    from gsp.proofs.verification import verify as verified

    try:
        found = verified(file)
    except OSError as error:
        raise GspError(
            "the proof cannot be read.", "Name another file.", got=f"{file}: {error.strerror}"
        ) from None
    except Rejected as error:
        if as_json:
            print_json({"holds": False, "reason": str(error)})
        else:
            click.echo(f"the proof does not hold: {error}")
        click.get_current_context().exit(1)
    if as_json:
        print_json({"holds": True, **found.as_dict()})
    else:
        click.echo(str(found))
