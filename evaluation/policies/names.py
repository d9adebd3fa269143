"""Names of the policies, as `--policy` takes them; importing them costs nothing."""

from pathlib import Path

ORACLE = "oracle"  # the expert, which knows the path and is run by the replay itself
VLM = "vlm"  # a vision-language model; the environment says where
MAP = "map"  # an online semantic map; labels are the renderer's
MAP_LLM = "map-llm"  # the same with sub-goals by a language model; the environment says where
MAP_VLM = "map-vlm"  # the same with labels by a vision-language model
MAP_VLM_LLM = "map-vlm-llm"  # both
MAPS = (MAP, MAP_LLM, MAP_VLM, MAP_VLM_LLM)
MODEL_POLICIES = (VLM, MAP_LLM, MAP_VLM, MAP_VLM_LLM)
HTTP_SCHEMES = ("http://", "https://")
SERVER_SCHEMES = ("ws://", "wss://", *HTTP_SCHEMES)
CHECKPOINT_SUFFIX = ".safetensors"
SERVER_FORMS = ("ws://HOST:PORT", "http://HOST:PORT")  # as messages name them


def shipped_policies() -> dict[str, Path]:
    """Return the checkpoints that come with vlnpe, by name."""
    folder = Path(__file__).resolve().parents[2] / "learning" / "policies"
    return {path.stem: path for path in sorted(folder.glob(f"*{CHECKPOINT_SUFFIX}"))}
