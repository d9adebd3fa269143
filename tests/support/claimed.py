"""A text about the path through two rooms, as steps with claims."""

from typing import Any

STEPS: list[dict[str, Any]] = [
    {
        "words": "Turn left through the doorway into the kitchen",
        "claims": [
            {"kind": "turn", "side": "left"},
            {"kind": "enter", "what": "room", "name": "kitchen", "side": "left"},
        ],
    },
    {
        "words": "and stop next to the table.",
        "claims": [{"kind": "stop", "what": "thing", "name": "table"}],
    },
]
