"""Settings of instructions from the command line."""

from ...instruction_gen.llm.settings import LlmSettings, settings_from
from ...instruction_gen.records import LLM, LOCAL, InstructConfig, parse_languages, parse_styles
from ..options.shared import Wording


def instruct_config(options: Wording) -> InstructConfig:
    """Return the configuration of the instructions that `collect` and `instruct` write."""
    server = None
    if options.writer in (LLM, LOCAL):
        server = settings_from(
            local=options.writer == LOCAL, max_tokens=options.max_tokens, max_cost=options.max_cost
        )
    return InstructConfig(
        writer=options.writer,
        styles=parse_styles(options.style),
        count=options.count,
        languages=parse_languages(options.language),
        replace=options.replace,
        llm=server,
    )


def vision_settings(options: Wording) -> LlmSettings | None:
    """Return the vision-language model that names things and rooms; None without `--vision`."""
    if not options.vision:
        return None
    return settings_from(
        asked_by="--vision", max_tokens=options.max_tokens, max_cost=options.max_cost
    )
