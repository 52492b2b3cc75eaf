"""One input through the reader and `check`: it ends with a verdict or with an error of our own."""

from __future__ import annotations

from pathlib import Path

from gsp.errors import GspError
from gsp.hyperbolicity.hyperbolicity import classify
from gsp.readers import load
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of


def read(text: str, folder: Path) -> Scene | GspError:
    """The scene of a text, or the refusal."""
    path = folder / "fuzzed.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        return load(path)
    except GspError as error:
        return error


def check(scene: Scene) -> str:
    """What `gsp check` answers; anything but an error of our own goes through."""
    try:
        study = study_of(scene)
        verdict = classify(study.branch, region=study.region, epsilon=scene.epsilon)
    except GspError as error:
        return f"refused: {error}"
    return str(verdict)
