from typing import Any

# The package ships no stubs of its compiled modules.
def __getattr__(name: str) -> Any: ...
