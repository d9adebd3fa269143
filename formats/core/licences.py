"""Licences of scenes: their identifiers, the hub's keys, and whether data may be published."""

import re
from collections.abc import Iterable

UNKNOWN, OTHER = "unknown", "other"

# All permit redistribution of renderings, with attribution; the hub has a key for the first ones.
_ON_HUB = (
    "apache-2.0 bsd-2-clause bsd-3-clause bsl-1.0 cc-by-3.0 cc-by-4.0 cc-by-nc-4.0 cc-by-nc-sa-4.0 "
    "cc-by-sa-3.0 cc-by-sa-4.0 cc0-1.0 cdla-permissive-1.0 cdla-permissive-2.0 cdla-sharing-1.0 "
    "isc mit odbl odc-by pddl unlicense zlib"
)
_REDISTRIBUTABLE = dict.fromkeys(_ON_HUB.split(), True) | {"0bsd": False, "mit-0": False}
# Renderings of a scan are a derived work, which these forbid to pass on.
_NO_DERIVATIVES = {"cc-by-nd-4.0", "cc-by-nc-nd-3.0", "cc-by-nc-nd-4.0"}

_TEXTS = (
    (r"apache license,? version 2\.0", "apache-2.0"),
    (r"permission is hereby granted, free of charge.*the above copyright notice", "mit"),
    (r"permission is hereby granted, free of charge", "mit-0"),
    (r"redistribution and use in source and binary forms.*neither the name", "bsd-3-clause"),
    (r"redistribution and use in source and binary forms", "bsd-2-clause"),
    (r"permission to use, copy, modify,? and/?or? distribute this software", "isc"),
    (r"creative commons attribution-noncommercial-noderiv\w* 4\.0", "cc-by-nc-nd-4.0"),
    (r"creative commons attribution-noderiv\w* 4\.0", "cc-by-nd-4.0"),
    (r"creative commons attribution-noncommercial-sharealike 4\.0", "cc-by-nc-sa-4.0"),
    (r"creative commons attribution-noncommercial 4\.0", "cc-by-nc-4.0"),
    (r"creative commons attribution-sharealike 4\.0", "cc-by-sa-4.0"),
    (r"creative commons attribution 4\.0|attribution 4\.0 international", "cc-by-4.0"),
    (r"cc0 1\.0 universal", "cc0-1.0"),
)

# A known text with such words in it was changed.
_LIMITS = r"non-?commercial|no derivative|research purposes? only|not redistribute"


def licence_id(text: str) -> str:
    """Return the lower-case identifier of a licence, from an identifier or the licence's text.

    `unknown` for an empty text, `other` for one that is not recognised.
    """
    words = " ".join(text.lower().split())
    if not words:
        return UNKNOWN
    if " " not in words:
        return words
    short = "-".join(w for w in words.split() if w not in ("the", "license", "licence"))
    if short in {*_REDISTRIBUTABLE, *_NO_DERIVATIVES}:
        return short
    name = next((name for pattern, name in _TEXTS if re.search(pattern, words)), OTHER)
    limited = re.search(_LIMITS, words) and not name.startswith("cc-")
    return OTHER if limited else name


def may_pass_on(identifier: str) -> bool:
    """Return whether renderings of a scene under this licence may be published; false in doubt."""
    return identifier in _REDISTRIBUTABLE


def why_not(identifier: str) -> str:
    """Return in words why data of such a scene may not be published."""
    if identifier in _NO_DERIVATIVES:
        return f"{identifier} forbids distributing derived works"
    if identifier == UNKNOWN:
        return "its licence is unknown"
    return f"its licence ({identifier}) is not known to permit it"


def hub_licence(identifiers: Iterable[str]) -> dict[str, str]:
    """Return the licence keys of a dataset card for data made from scenes with these licences."""
    names = sorted(set(identifiers)) or [UNKNOWN]
    on_hub = _REDISTRIBUTABLE.get(names[0], names[0] in {UNKNOWN, *_NO_DERIVATIVES})
    if len(names) == 1 and on_hub:
        return {"license": names[0]}
    link = "meta/provenance.json"
    return {"license": OTHER, "license_name": "-and-".join(names), "license_link": link}
