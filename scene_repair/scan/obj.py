"""Drop the faces of an OBJ file whose vertices do not exist, which the library refuses."""

import re

_VERTEX = re.compile(rb"^[ \t]*v[ \t]", re.MULTILINE)
# A statement goes on in the next line after a backslash.
_FACE = re.compile(rb"^[ \t]*f[ \t]((?:[^\r\n\\]|\\\r?\n|\\)*)\r?$", re.MULTILINE)
_NUMBER = re.compile(rb"[+-]?[0-9]+")


def without_bad_faces(data: bytes) -> tuple[bytes, int]:
    """Return an OBJ file without faces of missing vertices, and how many there were.

    Numbers count from 1 over the whole file; negative ones count back from the vertices so far.
    """
    vertices = [match.start() for match in _VERTEX.finditer(data)]
    pieces: list[bytes] = []
    at = dropped = before = 0
    for face in _FACE.finditer(data):
        while before < len(vertices) and vertices[before] < face.start():
            before += 1
        corners = [word.split(b"/")[0] for word in face[1].replace(b"\\", b" ").split()]
        if not all(_exists(corner, before, len(vertices)) for corner in corners):
            pieces.append(data[at : face.start()])
            at, dropped = face.end(), dropped + 1
    return b"".join([*pieces, data[at:]]), dropped


def _exists(corner: bytes, before: int, total: int) -> bool:
    # Longer numbers are out of range in any case.
    if len(corner) > 18 or not _NUMBER.fullmatch(corner):
        return False
    number = int(corner)
    return 1 <= number <= total or -before <= number <= -1
