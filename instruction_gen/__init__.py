"""Reference path and landmarks in, checked navigation instructions out (floor 2)."""

from .check import check_instruction
from .compose import compose_instruction
from .instruct import COMPOSERS, InstructResult, instruct_episodes
from .records import InstructConfig, Instruction, Mention

__all__ = [
    "COMPOSERS",
    "InstructConfig",
    "InstructResult",
    "Instruction",
    "Mention",
    "check_instruction",
    "compose_instruction",
    "instruct_episodes",
]
