"""Commands that check: `gsp check`, `gsp verify`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from gsp.cli.asking import asks, json_option, output_option
from gsp.cli.program import cli
from gsp.cli.telling import check_interrupt, check_parent, give, print_json, progress_bar, tell, tell_notes
from gsp.errors import DeclarationError, GspError

if TYPE_CHECKING:
    from gsp.cycles.cycle_certificate import CycleCertificate
    from gsp.cycles.passage_certificate import PassageCertificate
    from gsp.scenes.scene import Scene
    from gsp.scenes.study import Study


@cli.command()
@asks("set", "epsilon", "region", "small", "fast", looks=True)
@click.option(
    "--prove", is_flag=True, help="Prove the conditions in ball arithmetic, in place of sampling them."
)
@click.option("--prove-cycle", is_flag=True, help="Prove a relaxation cycle for every epsilon up to a bound.")
@click.option(
    "--prove-passage", is_flag=True, help="Prove how orbits from the start pass the first loss of stability."
)
@output_option("Write the proof to this file; `gsp verify` checks it.")
@json_option
def check(
    scene: Scene, prove: bool, prove_cycle: bool, prove_passage: bool, output: Path | None, as_json: bool
) -> None:
    """Check the conditions of normal hyperbolicity of MODEL over its region.

    The exit status is 0 if every condition holds at the samples, and 1 if one fails. With --prove it is 0 if normal
    hyperbolicity is proved, 1 if it is refuted, and 3 if it is undecided. With --prove-cycle and --prove-passage it is
    0 if the proof holds for every epsilon up to the model's, and 3 otherwise.
    """
    from gsp.scenes.sheet import explain_sheet
    from gsp.scenes.study import study_of

    if prove + prove_cycle + prove_passage > 1:
        raise DeclarationError(
            "--prove, --prove-cycle and --prove-passage cannot be combined.", "Run them one after the other."
        )
    if output is not None and not (prove or prove_cycle or prove_passage):
        raise DeclarationError(
            "-o writes a proof, but only samples were asked for.",
            "Add --prove, --prove-cycle or --prove-passage, or leave -o out.",
        )
    if output is not None:
        check_parent(output)
    study = study_of(scene)
    if prove_cycle or prove_passage:
        with progress_bar("cycle" if prove_cycle else "passage") as advance:
            found = _cycle(study, advance) if prove_cycle else _passage(study, advance)
            # The checker looks at what is written, which takes longer than the proof.
            if output is not None and found.verdict.name == "PROVED":
                advance(1.0, "check")
                found.save(output)
        _tell_up_to(study.scene, found, as_json)
    tell_notes(explain_sheet(study.critical, study.branch, study.start, study.region))
    if prove:
        from gsp.slow_tubes.certify import certify

        with progress_bar("boxes") as advance:
            certificate = certify(
                study.branch, region=study.region, epsilon=study.scene.epsilon, progress=advance
            )
            if output is not None and certificate.verdict.name == "PROVED":
                certificate.save(output)
        give(certificate, as_json, name=scene.name)
        click.get_current_context().exit({"PROVED": 0, "REFUTED": 1, "UNDECIDED": 3}[certificate.verdict.name])
    verdict = study.hyperbolicity
    if as_json:
        from gsp.report import hyperbolicity_as_json

        content = hyperbolicity_as_json(verdict, epsilon=study.scene.epsilon)
        print_json({"name": scene.name, "holds": verdict.holds, **content})
    else:
        tell(verdict)
    fails = not all(condition.holds for condition in verdict.conditions)
    click.get_current_context().exit(0 if verdict.holds else 1 if fails else 3)


def _cycle(study: Study, advance: Callable[..., None]) -> CycleCertificate:
    from gsp.singular.singular_orbit import singular_orbit
    from gsp.slow_tubes.certify import certify

    # Slow pieces that are followed until a singular orbit closes.
    orbit = singular_orbit(study.branch, study.start, max_pieces=60, progress=lambda pieces: check_interrupt())
    return certify(orbit, progress=advance)


def _passage(study: Study, advance: Callable[..., None]) -> PassageCertificate:
    """Through the fold in which the slow piece from the start ends, or past what the branch meets."""
    from gsp.analysis.fold_surroundings import proved_passage
    from gsp.singular.singular_orbit import singular_orbit

    fold = singular_orbit(study.branch, study.start, max_pieces=1).pieces[0].fold
    return proved_passage(study, fold, progress=advance)


def _tell_up_to(scene: Scene, found: CycleCertificate | PassageCertificate, as_json: bool) -> NoReturn:
    """Tell what is proved up to an epsilon."""
    reaches = scene.epsilon <= found.epsilon_0
    give(found, as_json, name=scene.name, epsilon=scene.epsilon, reaches=reaches)
    if found.verdict.name == "PROVED" and not reaches and not as_json:
        tell(f"  undecided at {scene.system.epsilon} = {scene.epsilon:g} of the model, which is larger")
    raise SystemExit(0 if reaches else 3)


@cli.command()
@click.argument("file", type=click.Path(path_type=Path))
@json_option
def verify(file: Path, as_json: bool) -> None:
    """Check the proof in FILE, which `gsp check --prove -o FILE` wrote.

    The checker computes in whole numbers and shares no code with the prover. It also checks the proofs of --prove-cycle
    and --prove-passage, and those of tubes about slow manifolds, which their `save` writes.

    The exit status is 0 if the proof holds, and 1 if it does not.
    """
    from gsp.proofs.programs import Rejected
    from gsp.proofs.verification import verify as verified

    try:
        with progress_bar("verify"):
            found = verified(file)
    except OSError as error:
        raise GspError(
            "the proof cannot be read.", "Name another file.", got=f"{file}: {error.strerror}"
        ) from None
    except Rejected as error:
        if as_json:
            print_json({"holds": False, "reason": str(error)})
        else:
            tell(f"the proof does not hold: {error}")
        click.get_current_context().exit(1)
    give(found, as_json, holds=True)
