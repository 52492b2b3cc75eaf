"""What commands ask for: a model, options, and the scene that results."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gsp.cli.telling import check_interrupt, compiled_by_two, compiling_told, progress_bar, tell_notes
from gsp.errors import DeclarationError, GspError, printable

if TYPE_CHECKING:
    from gsp.reductions.reductions import Reductions
    from gsp.scenes.scene import Scene


def json_option(function: Any) -> Any:
    return click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")(function)


def orders_through(order: int | None) -> dict[str, Any]:
    """`orders`, 0 to `order`, as a keyword; none when the verb chooses them."""
    if order is None:
        return {}
    if order < 0:
        raise DeclarationError("--order is a non-negative integer.", got=order)
    return {"orders": tuple(range(order + 1))}


def _alone(context: click.Context, option: click.Parameter, value: str | None) -> str | None:
    if value is not None and "," in value:
        raise click.BadParameter(f"{value[:80]!r} is more than one name. Give one parameter.", context, option)
    return value


OPTIONS = {
    "set": click.option(
        "--set", "settings", multiple=True, metavar="NAME=VALUE",
        help="Give a parameter another value, such as 1/3. May be repeated.",
    ),
    "epsilon": click.option("--epsilon", metavar="VALUE", help="Value of the small parameter [the scene's]."),
    "region": click.option(
        "--region", "intervals", multiple=True, metavar="NAME=LOW:HIGH",
        help="Give a state another interval. May be repeated.",
    ),
    "small": click.option(
        "--small", metavar="NAME[,NAME]",
        help="Which parameter is small; of two, the fastest first [as in the model, else found].",
    ),
    "small alone": click.option(
        "--small", metavar="NAME", callback=_alone, help="Which parameter is small [the model's]."
    ),
    "fast": click.option(
        "--fast", metavar="NAME,...", help="Which variables are fast, if no parameter is small."
    ),
    "start": click.option("--start", metavar="NAME", help="Start from this entry of the model's [starts]."),
}  # fmt: skip


def output_option(text: str) -> Callable[[Any], Any]:
    """Give a command the option -o, whose help is `text`."""
    return click.option("-o", "--output", type=click.Path(path_type=Path), help=text)


def asks(*names: str, by_two: bool = False, looks: bool = False, tells: bool = False) -> Callable[[Any], Any]:
    """Give a command the argument MODEL and the options `names`; the command takes the scene that results.

    With `by_two` a second process helps to compile what the command needs, and begins before the model is read. With
    `looks` what is small is looked for in a model that does not say it; with `tells` the command takes that too, as
    `reductions`, None where nothing was looked for.
    """

    def decorate(function: Any) -> Any:
        @wraps(function)
        def command(
            *,
            model: str,
            settings: tuple[str, ...] = (),
            epsilon: str | None = None,
            intervals: tuple[str, ...] = (),
            start: str | None = None,
            small: str | None = None,
            fast: str | None = None,
            **others: Any,
        ) -> Any:
            keep_model(model, *others.values())
            with compiled_by_two() if by_two else nullcontext():
                scene = scene_with_options(load_scene(model), settings, None, intervals, start)
                scene = taken(scene, small, fast)
                with compiling_told():
                    found = found_small(scene, needed=not tells) if looks and not scene.has_small else None
                    if found is not None and found.taken is not None:
                        scene = found.taken.scene
                    if tells:
                        others["reductions"] = found
                    scene = scene_with_options(scene, (), epsilon, ())
                    if looks:
                        tell_variables(scene)
                    return function(scene=scene, **others)

        for name in reversed(names):
            command = OPTIONS[name](command)
        return click.argument("model")(command)

    return decorate


def keep_model(model: str, *options: object) -> None:
    """Refuse to write over the file that the model is read from, where one of the `options` is its path."""
    outputs = (option for option in options if isinstance(option, Path) and option.is_file())
    if any(os.path.isfile(model) and output.samefile(model) for output in outputs):
        raise DeclarationError("the output would be written over the model.", "Give another path.", got=model)


def tell_variables(scene: Scene) -> None:
    """Say in which variables and in which time a scene goes through that is not in slow time with a simple pole."""
    from gsp.scenes.slow_time import explain_slow_time, has_slow_time, in_slow_time
    from gsp.splitting.splitting import has_higher_pole, split
    from gsp.systems.system import SlowFastSystem, VectorField

    if isinstance(scene.system, VectorField) and has_higher_pole(scene.system):
        mu, scaling = scene.system.epsilon, split(scene.system).scaling
        tell_notes([f"the pole in {mu} is of higher order, and simple in scaled variables: {scaling}"])
    elif has_slow_time(scene.system):
        tell_notes([explain_slow_time(in_slow_time(scene), scene)])
    elif isinstance(scene.system, SlowFastSystem) and scene.system.stands_still:
        small = scene.system.epsilon
        tell_notes(
            [
                f"every slow rate vanishes at {small} = 0: those of [slow] are in slow time. Where x' = {small} f and "
                "y' = g was meant, write both under [states]"
            ]
        )


def found_small(scene: Scene, *, needed: bool) -> Reductions:
    """What was found to be fast in a scene; the table and the reason are told, and one is taken where it is needed."""
    from gsp.reductions.reductions import find_reductions

    with progress_bar("what is fast") as show:
        found = find_reductions(scene, progress=show)
    check_interrupt()
    with suppress(OSError):
        click.echo(printable(str(found)), err=True)
    if needed and found.taken is None:
        raise GspError(
            f"nothing in {scene.name or 'the model'} is seen to be fast, so that there is nothing to go on with.",
            "Name it: --small NAME for a parameter, --fast NAME,... for variables.",
        )
    return found


def taken(scene: Scene, small: str | None, fast: str | None) -> Scene:
    """The scene with the small parameter or the fast variables that were named; what that means is told."""
    if small is None and fast is None:
        return scene
    from gsp.scenes.small_parameter import explain_small, take_fast, take_small

    if small is not None and fast is not None:
        raise DeclarationError(
            "--small names a parameter and --fast variables; one of them says what is fast.", "Leave one out."
        )
    if small is not None:
        first, two, second = (part.strip() for part in small.partition(","))
        made = take_small(scene, parameter=first)
        made = replace(made, second=second) if two else made
    else:
        made = take_fast(scene, variables=[name.strip() for name in str(fast).split(",") if name.strip()])
    tell_notes(explain_small(made, scene))
    return made


def scene_with_options(
    scene: Scene,
    settings: tuple[str, ...],
    epsilon: str | None,
    intervals: tuple[str, ...],
    start: str | None = None,
) -> Scene:
    from gsp.readers import toml_values
    from gsp.scenes.settings import ask_again

    def pairs(option: str, texts: tuple[str, ...], form: str) -> Iterator[tuple[str, str]]:
        for text in texts:
            name, found, value = text.partition("=")
            if not (name.strip() and found and value.strip()):
                raise DeclarationError(f"{option} is given as {form}.", got=f"{text[:80]!r}")
            yield name.strip(), value.strip()

    parameters: dict[str, Any] = {
        name: toml_values.number(value, f"--set {name}")
        for name, value in pairs("--set", settings, "NAME=VALUE")
    }
    region = {}
    for name, value in pairs("--region", intervals, "NAME=LOW:HIGH"):
        low, found, high = value.partition(":")
        if not found:
            raise DeclarationError("--region is given as NAME=LOW:HIGH.", got=f"{name}={value[:80]!r}")
        region[name] = (
            float(toml_values.number(low.strip(), f"--region {name}")),
            float(toml_values.number(high.strip(), f"--region {name}")),
        )
    small = None if epsilon is None else float(toml_values.number(epsilon, "--epsilon"))
    if not parameters and not region and small is None and start is None:
        return scene
    return ask_again(scene, parameters=parameters, epsilon=small, region=region, start=start)


def load_scene(model: str) -> Scene:
    """The scene of a built-in name or of a model file; what was understood of a foreign one is told."""
    from gsp import models as builtin

    path = Path(model)
    # No built-in name has a dot.
    if path.suffix or len(path.parts) > 1 or os.path.isfile(path):
        from gsp.readers.loading import load_noted

        scene, notes = load_noted(path)
        tell_notes(notes)
        return scene
    return builtin.load(model)
