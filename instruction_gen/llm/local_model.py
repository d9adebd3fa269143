"""The process that a local model runs in: JSON lines in, JSON lines out.

The first line opens the model, each further one asks it; see `local`.
"""

import json
import os
import sys
from typing import Any


def main() -> None:
    """Answer until standard input ends."""
    # The library prints to standard output, too: replies go to a copy of it.
    with os.fdopen(os.dup(1), "w") as replies:
        os.dup2(2, 1)
        model: Any = None
        for line in sys.stdin:
            request = json.loads(line)
            try:
                if model is None:
                    model, done = opened(request), {}
                else:
                    done = answered(model, request)
            except Exception as error:
                done = {"error": " ".join(str(error).split())[:300] or type(error).__name__}
            print(json.dumps(done), file=replies, flush=True)


def opened(request: dict[str, Any]) -> Any:
    """Return the model in a file; the library says aloud what is wrong with it."""
    import llama_cpp  # pyright: ignore[reportMissingImports]

    return llama_cpp.Llama(**request, verbose=True)


def answered(model: Any, request: dict[str, Any]) -> dict[str, Any]:
    """Return content and tokens of one completion."""
    done = model.create_chat_completion(**request)
    used = done.get("usage", {})
    return {
        "content": done["choices"][0]["message"]["content"] or "",
        "prompt_tokens": used.get("prompt_tokens", 0),
        "completion_tokens": used.get("completion_tokens", 0),
    }


if __name__ == "__main__":
    main()
