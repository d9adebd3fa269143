"""The policies that ask a model behind an OpenAI-compatible server."""

from ...instruction_gen.llm.budget import Budget
from ..policy import ModelUse, Policy
from .llm import vlm
from .llm.ask import PROMPTS, TextModel, model_settings, model_version
from .map_policy import restated
from .map_policy.model_labels import ModelLabeller, labels_version
from .map_policy.policy import MapPolicy
from .names import MAP_LLM, MAP_VLM, MAP_VLM_LLM, VLM

_TEXT_PROMPTS = {VLM: vlm.PROMPT, MAP_LLM: restated.PROMPT, MAP_VLM_LLM: restated.PROMPT}
_LABELLED = (MAP_VLM, MAP_VLM_LLM)


def make_model_policy(name: str, use: ModelUse) -> Policy:
    """Return a policy by name; nothing is sent yet."""
    settings = model_settings(name, use)
    text = None
    if name in _TEXT_PROMPTS:
        text = TextModel(settings, _TEXT_PROMPTS[name], Budget(use.cache / "usage.json", settings))
    if name == VLM and text is not None:
        return vlm.VlmPolicy(text)
    labeller = ModelLabeller(settings, use.cache) if name in _LABELLED else None
    return MapPolicy(labeller) if text is None else MapPolicy(labeller, restated.ModelReader(text))


def model_identity(name: str, use: ModelUse) -> str:
    """Return a text that identifies a policy's model and prompts, for reusing results."""
    settings = model_settings(name, use)
    parts = [name]
    if name in _TEXT_PROMPTS:
        parts.append(model_version(settings, (PROMPTS / _TEXT_PROMPTS[name]).read_bytes()))
    if name in _LABELLED:
        parts.append(f"labels {labels_version(settings)}")
    return " ".join(parts)
